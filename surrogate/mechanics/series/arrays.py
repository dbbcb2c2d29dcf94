"""What arrays of NumPy and tensors of PyTorch have in common, but not by the same name."""

from __future__ import annotations

from types import ModuleType
from typing import Any

import numpy as np
import torch

Array = Any  # of NumPy, or a Tensor


def library_of(array: Array) -> ModuleType:
    """NumPy or PyTorch."""
    return torch if isinstance(array, torch.Tensor) else np


def like(other: Array, x: Array) -> Array:
    """The same numbers in the precision of another array."""
    return x.to(other) if isinstance(x, torch.Tensor) else x.astype(other.dtype, copy=False)


def in_double(a: Array) -> Array:
    """The same numbers in double precision."""
    return a.double() if isinstance(a, torch.Tensor) else a.astype(np.float64, copy=False)


def rounding_of(a: Array) -> float:
    """Relative rounding of a number in the precision of an array."""
    return float(library_of(a).finfo(a.dtype).eps)
