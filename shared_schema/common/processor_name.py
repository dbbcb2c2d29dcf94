"""Name of the processor, recorded beside every measured time."""

from __future__ import annotations

import platform
from pathlib import Path

PROCESSORS = Path("/proc/cpuinfo")  # of Linux


def processor() -> str:
    """Name of the processor, or its architecture if the system does not tell its name."""
    if PROCESSORS.is_file():
        for line in PROCESSORS.read_text().splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.machine()
