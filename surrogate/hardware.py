"""Name of the hardware that a computation ran on."""

from __future__ import annotations

import torch

from shared_schema.common.processor import processor


def hardware(device: torch.device) -> str:
    """Name the processor and its threads in use, and the GPU if the device is one."""
    if device.type == "cuda":
        return f"{torch.cuda.get_device_name(device)}, {processor()}"
    threads = torch.get_num_threads()
    return f"{processor()}, {threads} thread{'s' if threads > 1 else ''}"
