"""Columns of a large linear map, which are found when they are first asked for, and kept."""

from __future__ import annotations

from collections.abc import Callable
from threading import Lock
from typing import Any

import numpy as np
from numpy.typing import NDArray

KEPT = 2**31  # bytes of all columns that may be kept
LOADED = 30  # inputs of one load for which columns are summed


class KeptColumns:
    """Columns of a linear map from forces to displacements, in single precision.

    Parameters
    ----------
    respond : callable
        The map: (N, size) → (N, size), in double precision.
    size : int
        Number of inputs, and of outputs.
    """

    def __init__(self, respond: Callable[[NDArray[np.float64]], NDArray[Any]], size: int) -> None:
        self.respond, self.size = respond, size
        self._columns: NDArray[np.float32] | None = None
        self._is_kept = np.zeros(size, dtype=bool)
        self._lock = Lock()

    def __reduce__(self) -> tuple[Any, ...]:
        return KeptColumns, (self.respond, self.size)  # without what is kept

    @property
    def fit(self) -> bool:
        """Tell whether all columns may be kept."""
        return 4 * self.size**2 <= KEPT

    def __getitem__(self, numbers: NDArray[np.int64]) -> NDArray[np.float32]:
        """Columns of some inputs, as rows: (n, size)."""
        with self._lock:
            if self._columns is None:
                self._columns = np.empty((self.size, self.size), dtype=np.float32)
            missing = numbers[~self._is_kept[numbers]]
            if len(missing):
                unit = np.zeros((len(missing), self.size))
                unit[np.arange(len(missing)), missing] = 1
                self._columns[missing] = self.respond(unit)
                self._is_kept[missing] = True
            return self._columns[numbers]
