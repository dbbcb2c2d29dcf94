r"""Factors on predicted standard deviations, fitted to samples that were kept out of training.

.. math:: σ^2 = a^2 σ_{\text{aleatoric}}^2 + b^2 σ_{\text{epistemic}}^2

with a and b of greatest likelihood (Kuleshov et al. 2018; Laves et al. 2020).
A heteroscedastic network explains the error of one draw of its weights, so that the mean over
draws, which errs less, is given the weights' spread twice; and errors on training samples are not
those on others.

Beyond the forces of the training nothing is known of either, and the factors tend to 1 there
(`NodalNetwork.factors`).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from surrogate.data.dataset import Samples
from surrogate.inference.prediction import Distribution, Surrogate
from surrogate.uncertainty.calibration import negative_log_likelihood

BOUNDS = (-6.0, 6.0)  # of ln a and ln b
PASSES = 100
Array = NDArray[np.float64]


def fit_factors(
    predicted: Distribution, reference: Array, free: NDArray[np.bool_]
) -> tuple[float, float]:
    """Find a and b; b is 1 where there is no epistemic part.

    Parameters
    ----------
    predicted : Distribution
        Of n samples, (n, n_nodes, d).
    reference : array, (n, n_nodes, d)
        u in m.
    free : array of bool, (n_nodes,)
        Nodes that are not clamped.
    """
    error = (reference - predicted.mean)[:, free]
    aleatoric, epistemic = predicted.std_aleatoric[:, free], predicted.std_epistemic[:, free]
    has_epistemic = bool(epistemic.any())

    def loss(logarithms: Array) -> float:
        a, b = np.exp(logarithms[0]), np.exp(logarithms[-1])
        return float(negative_log_likelihood(error, np.hypot(a * aleatoric, b * epistemic)).mean())

    start = np.zeros(2 if has_epistemic else 1)
    found = np.exp(minimize(loss, start, bounds=[BOUNDS] * len(start)).x)
    return float(found[0]), float(found[-1]) if has_epistemic else 1.0


def recalibrate(surrogate: Surrogate, held_out: Samples) -> None:
    """Set the factors of a surrogate's network.

    Parameters
    ----------
    surrogate : Surrogate
        Its factors are 1.
    held_out : Samples
        Neither trained on nor tested on.
    """
    geometry, network = surrogate.geometry, surrogate.network
    force, reference = (
        geometry.grid.to_nodes(field.double().cpu().numpy())
        for field in (held_out.force, held_out.displacement)
    )
    predicted = surrogate.predict_distribution(force, PASSES)
    a, b = fit_factors(predicted, reference, ~geometry.clamped)
    network.aleatoric_factor.fill_(a)
    network.epistemic_factor.fill_(b)
