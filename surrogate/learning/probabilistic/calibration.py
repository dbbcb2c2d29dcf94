r"""Measures of predicted uncertainty against the errors of the predictions.

Every component is predicted as a Gaussian with mean μ and standard deviation σ in m; u is the
reference, :math:`z = (u - μ) / σ`, φ and Φ are the standard normal's density and
distribution function. Held components are known (σ = 0, no error) and are left out everywhere.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, ndtri

from surrogate.mechanics.body.geometry import at_free, by_component, require_positive

Array = NDArray[np.float64]

INTERVALS = (0.5, 0.9, 0.95)
LEVELS = 101  # points of the calibration curve


@dataclass(frozen=True)
class IntervalMeasures:
    """Coverage and width of the central intervals of one level.

    Attributes
    ----------
    level : float
        Nominal coverage p.
    coverage : float
        Share of the components inside their intervals.
    width : float
        Mean width in m.
    """

    level: float
    coverage: float
    width: float


@dataclass(frozen=True)
class CalibrationMeasures:
    """Scores and calibration of predictions of M samples, over the free components.

    Attributes
    ----------
    samples : int
        Number of samples M.
    negative_log_likelihood : float
        Mean over the components in nats, of densities in 1/m: negative where σ is small.
    crps : float
        Mean continuous ranked probability score in m.
    intervals : tuple of IntervalMeasures
        Measures of the central intervals of the levels ``INTERVALS``.
    levels, observed : tuple of float
        Calibration curve: observed coverage over expected level.
    miscalibration_area : float
        Area between that curve and the diagonal.
    node_rank_correlation : float
        Spearman's rank correlation of ‖σ‖₂ and ‖U − u‖₂ over a sample's nodes, averaged over the
        samples.
    sample_rank_correlation : float
        Spearman's rank correlation of a sample's mean σ and its e_m, over the samples.
    mean_std : float
        Sharpness: mean σ in m.
    """

    samples: int
    negative_log_likelihood: float
    crps: float
    intervals: tuple[IntervalMeasures, ...]
    levels: tuple[float, ...]
    observed: tuple[float, ...]
    miscalibration_area: float
    node_rank_correlation: float
    sample_rank_correlation: float
    mean_std: float

    def plain(self) -> dict[str, Any]:
        """Return the measures as plain data."""
        return asdict(self)


def negative_log_likelihood(error: Array, std: Array) -> Array:
    r""":math:`\frac{1}{2} \ln(2πσ^2) + \frac{1}{2} z^2` of errors u − μ and σ in m, in nats."""
    return 0.5 * np.log(2 * np.pi) + np.log(std) + 0.5 * (error / std) ** 2


def crps(error: Array, std: Array) -> Array:
    r"""Continuous ranked probability score of a Gaussian, from errors u − μ and σ in m, in m.

    .. math::
        \int (F(x) - 1_{x \ge u})^2 \, dx
        = σ \left[ z (2Φ(z) - 1) + 2φ(z) - \frac{1}{\sqrt π} \right]

    (Gneiting and Raftery 2007, Section 4.2). It falls to \|u − μ\| as σ vanishes.
    """
    z = error / std
    density = np.exp(-0.5 * z**2) / np.sqrt(2 * np.pi)
    return std * (z * (2 * ndtr(z) - 1) + 2 * density - 1 / np.sqrt(np.pi))


def half_width(level: float) -> float:
    """Half width of the standard normal's central interval of a level: Φ⁻¹((1 + level) / 2)."""
    return float(ndtri(0.5 + 0.5 * level))


def calibration_curve(error: Array, std: Array) -> tuple[Array, Array]:
    r"""Return expected levels p and the share of errors that the central intervals of p cover.

    .. math:: \hat p(p) = \frac{1}{N} \#\{ i : 2Φ(|z_i|) - 1 \le p \}

    This is the calibration curve of Kuleshov, Fenner and Ermon (2018) for central instead of
    one-sided intervals. It lies below the diagonal if σ is too small, above it if σ is too large.

    Parameters
    ----------
    error, std : array of any shape
        u − μ and σ in m.

    Returns
    -------
    levels, observed : array, (LEVELS,)
        Values from 0 to 1.
    """
    levels = np.linspace(0.0, 1.0, LEVELS)
    reached = np.sort(2 * ndtr(np.abs(error / std)) - 1, axis=None)
    return levels, np.searchsorted(reached, levels, side="right") / reached.size


def miscalibration_area(levels: Array, observed: Array) -> float:
    r""":math:`\int_0^1 |\hat p(p) - p| \, dp` by the trapezoidal rule; 0 at best, 1/2 at worst."""
    from scipy.integrate import trapezoid

    return float(trapezoid(np.abs(observed - levels), levels))


def rank_correlation(x: Array, y: Array) -> Array:
    """Spearman's rank correlation along the last axis: (..., n) twice → (...).

    Pearson's correlation of the ranks, ties having their mean rank; 0 where x or y is constant.
    `scipy.stats.spearmanr` correlates two rows at a time, and is undefined there.
    """
    from scipy.stats import rankdata

    mean_rank = 0.5 * (x.shape[-1] + 1)
    a, b = rankdata(x, axis=-1) - mean_rank, rankdata(y, axis=-1) - mean_rank
    scale = np.sqrt((a**2).sum(axis=-1) * (b**2).sum(axis=-1))
    return (a * b).sum(axis=-1) / np.where(scale > 0, scale, 1.0)


def measure_calibration(
    mean: Array, std: Array, reference: Array, free: NDArray[np.bool_]
) -> CalibrationMeasures:
    """Measure predicted distributions against reference solutions.

    Parameters
    ----------
    mean, std, reference : array, (M, n_nodes, d)
        μ, σ and u in m.
    free : array of bool, (n_nodes, d) or (n_nodes,)
        Components that are not held, or nodes that are not clamped.

    Raises
    ------
    ValueError
        If σ is not positive and finite at a free component.
    """
    require_positive(std, free)
    error, sigma = at_free(reference - mean, free), at_free(std, free)
    magnitude = np.abs(error)
    levels, observed = calibration_curve(error, sigma)
    mean_std = float(sigma.mean())
    intervals = tuple(
        IntervalMeasures(
            level,
            coverage=float(np.mean(magnitude <= half_width(level) * sigma)),
            width=2 * half_width(level) * mean_std,
        )
        for level in INTERVALS
    )
    nodes, kept = free.any(axis=1) if free.ndim == 2 else free, by_component(free, std.shape[-1])
    by_node = rank_correlation(
        *(np.linalg.norm((kept * field)[:, nodes], axis=2) for field in (std, reference - mean))
    )
    by_sample = rank_correlation(sigma.mean(axis=(1, 2)), magnitude.mean(axis=(1, 2)))
    return CalibrationMeasures(
        samples=len(error),
        negative_log_likelihood=float(negative_log_likelihood(error, sigma).mean()),
        crps=float(crps(error, sigma).mean()),
        intervals=intervals,
        levels=tuple(levels.tolist()),
        observed=tuple(observed.tolist()),
        miscalibration_area=miscalibration_area(levels, observed),
        node_rank_correlation=float(by_node.mean()),
        sample_rank_correlation=float(by_sample),
        mean_std=mean_std,
    )
