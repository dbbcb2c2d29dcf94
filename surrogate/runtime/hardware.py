"""The hardware of a computation: its name and its memory."""

from __future__ import annotations

import errno
from collections.abc import Iterator
from contextlib import contextmanager

import torch

from shared_schema.common.errors import InputError, first_line
from shared_schema.common.machine import GIB, processor, require_memory

__all__ = ["hardware"]


def hardware(device: torch.device) -> str:
    """Return the names of GPU and processor, or processor and number of threads on a CPU."""
    if device.type == "cuda":
        return f"{torch.cuda.get_device_name(device)}, {processor()}"
    threads = torch.get_num_threads()
    return f"{processor()}, {threads} thread{'s' if threads > 1 else ''}"


def require_device_memory(needed: int, what: str, device: torch.device) -> None:
    """Raise InputError, beginning with `what`, if a device has less memory than needed, in bytes.

    On a CPU, the memory that is free counts; on a GPU, all of its memory.
    """
    if device.type != "cuda":
        require_memory(needed, what)
        return
    total = torch.cuda.get_device_properties(device).total_memory
    if needed > total:
        raise InputError(
            f"{what}: needs {needed / GIB:.3g} GiB of memory at least, expected at most the "
            f"{total / GIB:.3g} GiB of {torch.cuda.get_device_name(device)}"
        )


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
