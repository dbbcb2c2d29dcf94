"""Predicted distribution of nodal displacements."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Distribution:
    """A Gaussian for every displacement component.

    Attributes
    ----------
    mean, std_epistemic, std_aleatoric : array, (n_nodes, d) or (N, n_nodes, d)
        Mean, and standard deviations due to random weights (epistemic) and to noise of the data
        (aleatoric), in m.
    """

    mean: Array
    std_epistemic: Array
    std_aleatoric: Array

    @property
    def std(self) -> Array:
        """Total standard deviation in m."""
        return np.hypot(self.std_epistemic, self.std_aleatoric)

    def reshaped(self, shape: tuple[int, ...]) -> Distribution:
        """Return a copy of the distribution with arrays of another shape."""
        return Distribution(
            self.mean.reshape(shape).copy(),
            self.std_epistemic.reshape(shape).copy(),
            self.std_aleatoric.reshape(shape).copy(),
        )

    def fields(self) -> dict[str, Array]:
        """Return copies of the arrays by their names in solution files."""
        return {
            "displacement": self.mean.copy(),
            "std": self.std,
            "std_epistemic": self.std_epistemic.copy(),
            "std_aleatoric": self.std_aleatoric.copy(),
        }
