"""What arrays of NumPy and tensors of PyTorch have in common, but not by the same name."""

from __future__ import annotations

from types import ModuleType
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

Array = Any  # of NumPy, or a Tensor


def library_of(array: Array) -> ModuleType:
    """NumPy or PyTorch."""
    return torch if isinstance(array, torch.Tensor) else np


def like(other: Array, x: Array) -> Array:
    """The same numbers in the precision of another array."""
    if isinstance(x, torch.Tensor):
        return x.to(other)
    return x if x.dtype == other.dtype else x.astype(other.dtype)


def in_double(a: Array) -> Array:
    """The same numbers in double precision."""
    if isinstance(a, torch.Tensor):
        return a.double()
    return a if a.dtype == np.float64 else a.astype(np.float64)


def rounding_of(a: Array) -> float:
    """Relative rounding of a number in the precision of an array."""
    return float(library_of(a).finfo(a.dtype).eps)


def on_device_of(other: Array, values: NDArray[np.float64]) -> Array:
    """Constants as an array of the kind and device of another one, in double precision."""
    return torch.from_numpy(values).to(other.device) if isinstance(other, torch.Tensor) else values


def constant(values: NDArray[np.float64], other: Array) -> Array:
    """The same as an array of the kind, precision and device of another one."""
    return like(other, on_device_of(other, values))
