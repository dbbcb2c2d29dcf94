r"""Factors on predicted standard deviations, fitted to samples held out of training.

.. math:: σ^2 = a^2 σ_{\text{aleatoric}}^2 + b^2 σ_{\text{epistemic}}^2

with a and b of greatest likelihood (Kuleshov et al. 2018; Laves et al. 2020). There are two reasons
to correct σ. The aleatoric σ of a heteroscedastic network includes the error of single draws of the
weights; the mean over draws has a smaller error, so that its σ counts weight uncertainty twice. And
errors on training samples differ from errors on other samples.

Errors with heavier tails than a Gaussian's leave too many values outside wide intervals. For a
level p, both factors are multiplied by one more, with which intervals of p hold the share p.

Both factors are multiplied by c(n), by the number n of loaded nodes: the same measure, the mean of
z² = 1 or the share p, then holds in every group of samples with like numbers of loaded nodes
(calibration by groups, Vovk et al. 2005, Section 4.5).

Held-out samples tell nothing about forces beyond the training range; there the factors tend to 1
(`NodalNetwork.factors`).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from surrogate.learning.data.samples import NodalSamples
from surrogate.learning.inference.surrogate import Surrogate
from surrogate.learning.networks.load_count_factor import KNOTS
from surrogate.learning.probabilistic.calibration import half_width, negative_log_likelihood
from surrogate.learning.probabilistic.distribution import Distribution
from surrogate.mechanics.body.geometry import at_free

BOUNDS = (-6.0, 6.0)  # bounds of ln a and ln b
LEAST = 30  # samples of a group
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
    free : array of bool, (n_nodes, d) or (n_nodes,)
        Components that are not held, or nodes that are not clamped.
    level : float, optional
        Level p whose intervals are to hold the share p.
    """
    error = at_free(reference - predicted.mean, free)
    aleatoric = at_free(predicted.std_aleatoric, free)
    epistemic = at_free(predicted.std_epistemic, free)
    has_epistemic = bool(epistemic.any())

    def loss(logarithms: Array) -> float:
        a, b = np.exp(logarithms[0]), np.exp(logarithms[-1])
        return float(negative_log_likelihood(error, np.hypot(a * aleatoric, b * epistemic)).mean())

    start = np.zeros(2 if has_epistemic else 1)
    found = np.exp(minimize(loss, start, bounds=[BOUNDS] * len(start)).x)
    if level is not None:
        found *= common_factor(error / np.hypot(found[0] * aleatoric, found[-1] * epistemic), level)
    return float(found[0]), float(found[-1]) if has_epistemic else 1.0


def common_factor(z: Array, level: float | None = None) -> float:
    """Factor on σ with which z = (u − μ) / σ has a mean square of 1, or intervals their share.

    Parameters
    ----------
    z : array
        Of all values.
    level : float, optional
        As `fit_factors` takes it.
    """
    if level is None:
        return float(np.sqrt((z**2).mean()))
    return float(np.quantile(np.abs(z), level) / half_width(level))


def groups_by_count(counts: NDArray[np.int64]) -> list[NDArray[np.bool_]]:
    """Group samples by their numbers of loaded nodes, from few to many; those without are left out.

    Parameters
    ----------
    counts : array of int, (n,)

    Returns
    -------
    list of array of bool, (n,)
        As many groups as there are numbers, but `KNOTS` at most, of `LEAST` samples at least; a
        single group if there are too few samples.
    """
    loaded = np.unique(counts[counts > 0])
    for number in range(min(KNOTS, len(loaded)), 1, -1):
        groups = [np.isin(counts, part) for part in np.array_split(loaded, number)]
        if min(group.sum() for group in groups) >= LEAST:
            return groups
    return [counts > 0]


def fit_count_factors(
    z: Array, counts: NDArray[np.int64], level: float | None = None
) -> tuple[list[float], list[float]]:
    """Fit factors by the number of loaded nodes.

    Parameters
    ----------
    z : array, (n, …)
        (u − μ) / σ of all free components.
    counts : array of int, (n,)
        Number of loaded nodes of every sample.
    level : float, optional
        As `fit_factors` takes it.

    Returns
    -------
    counts, factors : list of float
        Mean number of loaded nodes of every group, and its factor; 1 if there is a single group.
    """
    groups = groups_by_count(counts)
    if len(groups) == 1:
        return [1.0], [1.0]
    numbers = [float(counts[group].mean()) for group in groups]
    return numbers, [common_factor(z[group], level) for group in groups]


def recalibrate(surrogate: Surrogate, held_out: NodalSamples, level: float | None = None) -> None:
    """Fit the factors of a surrogate's network to held-out samples and set them.

    Parameters
    ----------
    surrogate : Surrogate
        Surrogate whose factors are 1.
    held_out : NodalSamples
        Samples used neither for training nor for testing.
    level : float, optional
        As `fit_factors` takes it.
    """
    geometry, network = surrogate.geometry, surrogate.network
    force, reference = held_out.force, held_out.displacement
    predicted = surrogate.passes_in_shapes(force, held_out.parameters, PASSES)
    free = geometry.free
    a, b = fit_factors(predicted, reference, free, level)
    network.aleatoric_factor.fill_(a)
    network.epistemic_factor.fill_(b)
    std = np.hypot(a * predicted.std_aleatoric, b * predicted.std_epistemic)
    z = at_free(reference - predicted.mean, free) / at_free(std, free)
    counts = np.count_nonzero(force.any(axis=2), axis=1)
    network.count_factor.set(*fit_count_factors(z, counts, level))
