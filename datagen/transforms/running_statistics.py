"""Statistics of the components of a field over samples that come shard by shard."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from shared_schema.manifest import ComponentStatistics


class RunningStatistics:
    """Mean, standard deviation and largest magnitude of each component, shard by shard."""

    def __init__(self) -> None:
        self._count = 0
        self._sum: Any = 0.0
        self._squares: Any = 0.0
        self._max: Any = 0.0

    def add(self, values: NDArray[np.float32]) -> None:
        """Add values of shape (N, d, n_nodes)."""
        if values.size == 0:
            return
        exact = values.astype(np.float64)
        self._count += exact.shape[0] * exact.shape[2]
        self._sum = self._sum + exact.sum(axis=(0, 2))
        self._squares = self._squares + (exact**2).sum(axis=(0, 2))
        self._max = np.maximum(self._max, np.abs(exact).max(axis=(0, 2)))

    def result(self) -> ComponentStatistics:
        """Statistics of all values so far."""
        mean = self._sum / self._count
        std = np.sqrt(np.maximum(self._squares / self._count - mean**2, 0.0))
        return ComponentStatistics(
            mean=tuple(mean.tolist()), std=tuple(std.tolist()), max_abs=tuple(self._max.tolist())
        )
