"""Name of the hardware that a computation ran on."""

from __future__ import annotations

import torch

from shared_schema.common.processor import processor


def hardware(device: torch.device) -> str:
    """Return the names of GPU and processor, or processor and number of threads on a CPU."""
    if device.type == "cuda":
        return f"{torch.cuda.get_device_name(device)}, {processor()}"
    threads = torch.get_num_threads()
    return f"{processor()}, {threads} thread{'s' if threads > 1 else ''}"
