"""The library of an array: functions of NumPy and PyTorch that have the same name do the same."""

from __future__ import annotations

import sys
from typing import Any

import numpy as np


def library_of(values: Any) -> Any:
    """NumPy of an array, PyTorch of a tensor."""
    return np if isinstance(values, np.ndarray) else sys.modules["torch"]
