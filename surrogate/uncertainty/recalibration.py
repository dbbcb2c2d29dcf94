r"""Factors on predicted standard deviations, fitted to samples held out of training.

.. math:: σ^2 = a^2 σ_{\text{aleatoric}}^2 + b^2 σ_{\text{epistemic}}^2

with a and b of greatest likelihood (Kuleshov et al. 2018; Laves et al. 2020). There are two reasons
to correct σ. The aleatoric σ of a heteroscedastic network includes the error of single draws of the
weights; the mean over draws has a smaller error, so that its σ counts weight uncertainty twice. And
errors on training samples differ from errors on other samples.

Errors with heavier tails than a Gaussian's leave too many values outside wide intervals. For a
level p, both factors are multiplied by one more, with which intervals of p hold the share p.

Held-out samples tell nothing about forces beyond the training range; there the factors tend to 1
(`NodalNetwork.factors`).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from surrogate.data.samples import Samples
from surrogate.inference.prediction import Distribution, Surrogate
from surrogate.uncertainty.calibration import half_width, negative_log_likelihood

BOUNDS = (-6.0, 6.0)  # bounds of ln a and ln b
PASSES = 100
Array = NDArray[np.float64]


def fit_factors(
    predicted: Distribution,
    reference: Array,
    free: NDArray[np.bool_],
    level: float | None = None,
) -> tuple[float, float]:
    """Fit a and b; b is 1 if there is no epistemic uncertainty.

    Parameters
    ----------
    predicted : Distribution
        Predictions of n samples, (n, n_nodes, d).
    reference : array, (n, n_nodes, d)
        u in m.
    free : array of bool, (n_nodes,)
        Nodes that are not clamped.
    level : float, optional
        Level p whose intervals are to hold the share p.
    """
    error = (reference - predicted.mean)[:, free]
    aleatoric, epistemic = predicted.std_aleatoric[:, free], predicted.std_epistemic[:, free]
    has_epistemic = bool(epistemic.any())

    def loss(logarithms: Array) -> float:
        a, b = np.exp(logarithms[0]), np.exp(logarithms[-1])
        return float(negative_log_likelihood(error, np.hypot(a * aleatoric, b * epistemic)).mean())

    start = np.zeros(2 if has_epistemic else 1)
    found = np.exp(minimize(loss, start, bounds=[BOUNDS] * len(start)).x)
    if level is not None:
        std = np.hypot(found[0] * aleatoric, found[-1] * epistemic)
        found *= np.quantile(np.abs(error / std), level) / half_width(level)
    return float(found[0]), float(found[-1]) if has_epistemic else 1.0


def recalibrate(surrogate: Surrogate, held_out: Samples, level: float | None = None) -> None:
    """Fit the factors of a surrogate's network to held-out samples and set them.

    Parameters
    ----------
    surrogate : Surrogate
        Surrogate whose factors are 1.
    held_out : Samples
        Samples used neither for training nor for testing.
    level : float, optional
        As `fit_factors` takes it.
    """
    geometry, network = surrogate.geometry, surrogate.network
    force, reference = (
        geometry.grid.to_nodes(field.double().cpu().numpy())
        for field in (held_out.force, held_out.displacement)
    )
    predicted = surrogate.predict_distribution(force, PASSES)
    a, b = fit_factors(predicted, reference, ~geometry.clamped, level)
    network.aleatoric_factor.fill_(a)
    network.epistemic_factor.fill_(b)
