r"""Predicted distribution of displacements: its mean and standard deviations.

For T passes with means :math:`μ_t` and standard deviations :math:`σ_t`,

.. math:: \bar μ = \frac{1}{T} \sum_t μ_t, \qquad
   σ^2 = \underbrace{\frac{1}{T-1} \sum_t (μ_t - \bar μ)^2}_{\text{epistemic}}
       + \underbrace{\frac{1}{T} \sum_t σ_t^2}_{\text{aleatoric}}

(Deshpande et al. 2022, Section 2.5; Kendall and Gal 2017).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from surrogate.learning.probabilistic.likelihoods import Prediction

Array = NDArray[np.float64]
ROUNDING = 2.0**-24  # relative, of a number in single precision


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

    @classmethod
    def joined(cls, parts: Sequence[Distribution]) -> Distribution:
        """Distributions of several loads, (N, n_nodes, d) each, one after the other."""
        names = "mean", "std_epistemic", "std_aleatoric"
        return cls(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))

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


class Moments(NamedTuple):
    """Sums over some passes, from which the moments follow without cancellation.

    Attributes
    ----------
    passes : int
        Number of passes T.
    mean : Tensor, (N, n_nodes, d)
        Mean of μ_t in m.
    squares, variances : Tensor of the same shape
        Sums of (μ_t − mean)² and of σ_t², in m².
    """

    passes: int
    mean: Tensor
    squares: Tensor
    variances: Tensor

    @classmethod
    def of(cls, prediction: Prediction) -> Self:
        """Sum over the passes of a prediction, (T, N, n_nodes, d)."""
        mean = prediction.mean.mean(dim=0)
        squares = (prediction.mean - mean).square().sum(dim=0)
        std = torch.zeros_like(prediction.mean) if prediction.std is None else prediction.std
        return cls(len(prediction.mean), mean, squares, std.square().sum(dim=0))

    def scaled(self, epistemic_factor: Tensor) -> Moments:
        """Return the sums with factors (N, 1, 1) on the epistemic standard deviation."""
        return self._replace(squares=self.squares * epistemic_factor.square())

    def joined(self, other: Moments) -> Moments:
        """Return the sums over both sets of passes (Chan, Golub and LeVeque 1983)."""
        passes, offset = self.passes + other.passes, other.mean - self.mean
        between = offset.square() * (self.passes * other.passes / passes)
        return Moments(
            passes,
            self.mean + offset * (other.passes / passes),
            self.squares + other.squares + between,
            self.variances + other.variances,
        )

    @property
    def std(self) -> Tensor:
        """Total standard deviation σ in m."""
        return (self.std_epistemic.square() + self.std_aleatoric.square()).sqrt()

    @property
    def std_epistemic(self) -> Tensor:
        """Standard deviation of the passes' means in m; zero for one pass.

        Passes agree no better than single precision tells them apart.
        """
        if self.passes == 1:
            return torch.zeros_like(self.squares)
        spread = (self.squares / (self.passes - 1)).sqrt()
        return torch.maximum(spread, ROUNDING * self.mean.abs())

    @property
    def std_aleatoric(self) -> Tensor:
        """Root mean square of the passes' standard deviations in m."""
        return (self.variances / self.passes).sqrt()
