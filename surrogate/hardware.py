"""Name of the hardware that a computation ran on."""

from __future__ import annotations

import platform
from pathlib import Path

import torch

PROCESSORS = Path("/proc/cpuinfo")


def hardware(device: torch.device) -> str:
    """Name the processor and its threads in use, and the GPU if the device is one."""
    if device.type == "cuda":
        return f"{torch.cuda.get_device_name(device)}, {processor()}"
    threads = torch.get_num_threads()
    return f"{processor()}, {threads} thread{'s' if threads > 1 else ''}"


def processor() -> str:
    """Name of the processor, or its architecture where the system tells no name."""
    if PROCESSORS.is_file():
        for line in PROCESSORS.read_text().splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.machine()
