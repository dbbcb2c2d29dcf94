"""The hardware of a computation: its name and its memory."""

from __future__ import annotations

import errno
import os
import resource
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import torch

from shared_schema.common.errors import InputError, first_line
from shared_schema.common.processor import processor

CONTROL_GROUPS = (  # memory limits of containers and batch jobs, of Linux
    Path("/sys/fs/cgroup/memory.max"),
    Path("/sys/fs/cgroup/memory/memory.limit_in_bytes"),
)
CPU = torch.device("cpu")


def hardware(device: torch.device) -> str:
    """Return the names of GPU and processor, or processor and number of threads on a CPU."""
    if device.type == "cuda":
        return f"{torch.cuda.get_device_name(device)}, {processor()}"
    threads = torch.get_num_threads()
    return f"{processor()}, {threads} thread{'s' if threads > 1 else ''}"


def memory(device: torch.device = CPU) -> int:
    """Return the memory in bytes that a device has, or that this process may use of the host's."""
    if device.type == "cuda":
        return int(torch.cuda.get_device_properties(device).total_memory)
    limits = [os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")]
    limits += [int(text) for path in CONTROL_GROUPS if (text := _text(path)).isdecimal()]
    limits += [n for n in resource.getrlimit(resource.RLIMIT_AS) if n != resource.RLIM_INFINITY]
    return min(limits)


def _text(path: Path) -> str:
    return path.read_text().strip() if path.is_file() else ""


def require_memory(needed: int, message: str, device: torch.device = CPU) -> None:
    """Raise InputError unless a device has some memory.

    Parameters
    ----------
    needed : int
        In bytes.
    message : str
        Message with ``{needed}`` and ``{available}``.
    device : torch.device
    """
    available = memory(device)
    if needed > available:
        raise InputError(message.format(needed=in_words(needed), available=in_words(available)))


def in_words(size: int) -> str:
    """Return a number of bytes in words, such as "1.5 GiB"."""
    return f"{size / 2**30:.3g} GiB" if size < 2**50 else f"{size / 2**30:.1e} GiB"


@contextmanager
def memory_errors() -> Iterator[None]:
    """Turn every error that says that no memory is left into a MemoryError."""
    try:
        yield
    except (OSError, RuntimeError) as error:
        if is_out_of_memory(error):
            raise MemoryError(first_line(error)) from None
        raise


def is_out_of_memory(error: BaseException) -> bool:
    """True if an error says that no memory is left, on the host or on a GPU."""
    if isinstance(error, MemoryError | torch.OutOfMemoryError):
        return True
    if isinstance(error, OSError) and error.errno == errno.ENOMEM:
        return True
    text = str(error)
    return any(w in text for w in ("an't allocate memory", "annot allocate memory", "new thread"))
