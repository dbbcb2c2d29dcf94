"""The device of a computation, the layout and precision on it, and its random numbers."""

from __future__ import annotations

import errno
from collections.abc import Iterator
from contextlib import contextmanager
from threading import Lock
from typing import Literal, Protocol

import numpy as np
import torch
from torch import nn

from shared_schema.common.errors import InputError, first_line
from shared_schema.common.machine import GIB, processor, require_memory

__all__ = ["Precision", "choose_device", "convolutions", "hardware", "lay_out"]
Precision = Literal["float32", "tensorfloat32", "bfloat16"]


def choose_device(name: str) -> torch.device:
    """Return the device of a given name; ``auto`` means cuda if there is one, else cpu.

    Raises
    ------
    InputError
        If there is no such device here.
    """
    if name == "auto":
        return torch.device("cuda" if torch.cuda.is_available() else "cpu")
    try:
        device = torch.device(name)
    except RuntimeError:
        device = None
    if device is None or device.type not in ("cpu", "cuda"):
        raise InputError(f"--device '{name}': expected 'cpu', 'cuda' or 'auto'")
    if device.type == "cuda" and (device.index or 0) >= torch.cuda.device_count():
        raise InputError(f"--device '{name}': none here, expected 'cpu' or 'auto'")
    return device


def flush_denormals() -> None:
    """Let numbers below 1e-38 be zero on the CPU, where they take a hundred times as long.

    Activations such as SiLU of a network that predicts small differences are full of them. Threads
    that are started later inherit this.
    """
    torch.set_flush_denormal(True)


def lay_out(network: nn.Module, dimension: int, precision: Precision, device: torch.device) -> None:
    """Move a network to a device, in the memory layout with the fastest convolutions.

    In two dimensions, the layout is channels last. In three dimensions, it is channels last on a
    CPU except in bfloat16, and on a GPU except in float32, because tensor cores need it.
    """
    contiguous = "float32" if device.type == "cuda" else "bfloat16"
    network.to(device)
    if dimension == 2:
        memory_format = torch.channels_last
    elif precision != contiguous:
        memory_format = torch.channels_last_3d
    else:
        return
    for parameter in network.parameters():
        if parameter.dim() == dimension + 2:  # convolution kernel
            parameter.data = parameter.data.contiguous(memory_format=memory_format)


def autocast(precision: Precision, device: torch.device) -> torch.autocast:
    """Return a context in which convolutions use a precision; float32 changes nothing."""
    return torch.autocast(device.type, torch.bfloat16, enabled=precision == "bfloat16")


@contextmanager
def convolutions(precision: Precision) -> Iterator[None]:
    """Enter a context in which convolutions of float32 on a GPU have a precision.

    PyTorch lets tensor cores round the factors to 11 significant bits (TF32, a relative error of
    5e-4) unless it is told otherwise. Here only ``tensorfloat32`` does so. Gradients are computed
    in the same context. Nothing changes on a CPU. The setting is that of all threads; the first
    one to enter changes it, and the last one to leave restores it.
    """
    with _CONVOLUTIONS.at(precision):
        yield


@contextmanager
def products_as_convolutions() -> Iterator[None]:
    """Enter a context in which matrix products have the precision that convolutions have.

    For convolutions that are written as products. All other products are in full precision.
    """
    rounded = torch.backends.cudnn.allow_tf32
    with _PRODUCTS.at("tensorfloat32" if rounded else "float32"):
        yield


class _Backend(Protocol):
    allow_tf32: bool


class _Switch:
    """Whether one kind of operation may use TF32, as threads want it in turn."""

    def __init__(self, backend: _Backend) -> None:
        self._backend, self._lock = backend, Lock()
        self._entered: list[Precision] = []  # by all threads, in their order
        self._before = True

    @contextmanager
    def at(self, precision: Precision) -> Iterator[None]:
        """Enter a context with a precision."""
        with self._lock:
            if not self._entered:
                self._before = self._backend.allow_tf32
            self._entered.append(precision)
            self._set()
        try:
            yield
        finally:
            with self._lock:
                self._entered.reverse()
                self._entered.remove(precision)  # the last one of these
                self._entered.reverse()
                self._set()

    def _set(self) -> None:
        last = self._entered[-1] if self._entered else None
        self._backend.allow_tf32 = self._before if last is None else last == "tensorfloat32"


_CONVOLUTIONS, _PRODUCTS = _Switch(torch.backends.cudnn), _Switch(torch.backends.cuda.matmul)


@contextmanager
def defaults_of_torch() -> Iterator[None]:
    """Make tensors as PyTorch does unless a program says otherwise.

    They are of single precision, on the CPU, and can take part in derivatives, whatever
    `torch.set_default_dtype`, `torch.set_default_device` or `torch.inference_mode` say outside.
    """
    before = torch.get_default_dtype()
    try:
        if before != torch.float32:  # threads share it
            torch.set_default_dtype(torch.float32)
        with torch.device("cpu"), torch.inference_mode(False):
            yield
    finally:
        if before != torch.float32:
            torch.set_default_dtype(before)


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


(
    INITIAL_WEIGHTS,
    VALIDATION,
    ORDER,
    NOISE,
    PASS,
    CALIBRATION,
    REFINEMENT,
) = range(7)


def stream(*numbers: int) -> int:
    """Return a 64-bit seed made from some numbers; different numbers give different seeds."""
    entropy = (len(numbers), *numbers)
    return int(np.random.SeedSequence(entropy).generate_state(1, np.uint64)[0])
