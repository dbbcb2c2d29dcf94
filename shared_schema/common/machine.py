"""The machine: memory that this process has taken and may still take, and the processor's name."""

from __future__ import annotations

import platform
import sys
from contextlib import suppress
from pathlib import Path

from shared_schema.common.errors import InputError

with suppress(ModuleNotFoundError):  # Windows has none
    import resource

GIB = 2**30
PROC, CGROUPS = Path("/proc"), Path("/sys/fs/cgroup")  # of Linux


def available_memory() -> float:
    """Bytes that this process may still take: of the machine, its container, its own limit.

    Infinite if the system does not say.
    """
    return min(_of_machine(), _of_container(), _of_process())


def require_memory(needed: float, what: str, argument: str = "") -> None:
    """Raise InputError if something needs more memory than there is.

    Parameters
    ----------
    needed : float
        Estimate in bytes, from below rather than from above.
    what : str
        What needs it, with the key or argument that says so.
    argument : str
        Name of the argument in Python with which that begins, if it does.
    """
    available = available_memory()
    if needed > available:
        raise InputError(
            f"{what}: needs {needed / GIB:.3g} GiB of memory at least, expected at most the "
            f"{available / GIB:.3g} GiB that are free",
            argument,
        )


def largest_resident() -> int:
    """Largest resident memory that this process has had so far, in bytes; 0 on Windows."""
    if "resource" not in globals():
        return 0
    unit = 1 if sys.platform == "darwin" else 1024
    return unit * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def megabytes(size: float) -> str:
    """Spell a size in bytes as megabytes."""
    return f"{size / 1e6:.0f} MB"


def _of_machine() -> float:
    for line in _lines(PROC / "meminfo"):
        if line.startswith("MemAvailable:"):
            return float(line.split()[1]) * 1024
    return float("inf")


def _of_container() -> float:
    """Limit of the control groups (version 2) that this process belongs to, less what is used."""
    free = float("inf")
    for line in _lines(PROC / "self" / "cgroup"):
        if line.startswith("0::"):
            group = CGROUPS / line[3:].strip("/")
            for folder in (group, *group.parents):
                limit = _lines(folder / "memory.max")
                used = _lines(folder / "memory.current")
                if limit and used and limit[0] != "max":
                    free = min(free, float(limit[0]) - float(used[0]) + _file_cache(folder))
    return free


def _file_cache(folder: Path) -> float:
    """Bytes of a control group that the system gives back when they are needed."""
    for line in _lines(folder / "memory.stat"):
        if line.startswith("inactive_file "):
            return float(line.split()[1])
    return 0.0


def _of_process() -> float:
    """Limit of the address space (``ulimit -v``), less what this process has."""
    sizes = _lines(PROC / "self" / "statm")
    if not sizes or "resource" not in globals():
        return float("inf")
    limit, _ = resource.getrlimit(resource.RLIMIT_AS)
    if limit == resource.RLIM_INFINITY:
        return float("inf")
    return limit - float(sizes[0].split()[0]) * resource.getpagesize()


def _lines(path: Path) -> list[str]:
    try:
        return path.read_text().splitlines()
    except OSError:
        return []


PROCESSORS = Path("/proc/cpuinfo")  # of Linux


def processor() -> str:
    """Name of the processor, or its architecture if the system does not tell its name."""
    if PROCESSORS.is_file():
        for line in PROCESSORS.read_text().splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.machine()
