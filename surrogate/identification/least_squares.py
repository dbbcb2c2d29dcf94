r"""Robust nonlinear least squares, with the covariance of what is found.

Measured are y = h(θ) + ε with some wild values among the rows of y. Gauss–Newton steps with the
Levenberg–Marquardt damping minimise

.. math:: \sum_m ρ(|y_m - h_m(θ)| / σ), \qquad ρ(t) = \tfrac{c^2}{2} \ln(1 + t^2 / c^2)

(Cauchy's, Holland and Welsch 1977, *Commun. Stat.* A6); σ follows from the median of the residuals
if it is not given. Rows farther off than `WILD` σ are then left out, and the others count fully, so
that the covariance is that of a linear model around the minimum (Laplace's approximation),

.. math:: C = σ^2 (J^T J)^{-1}, \qquad σ^2 = \frac{\sum_m |y_m - h_m|^2}{n - p},

with n numbers that count and p parameters; intervals are those of Student's t distribution of
n − p degrees of freedom, or of a normal distribution if σ is given.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm, t

from shared_schema.common.errors import WorkError

Array = NDArray[np.float64]

CAUCHY = 2.385  # c: 95 % efficiency under normal noise
WILD = 4.0
STEPS, ROUNDS = 40, 8
SETTLED = 1e-2  # decrease of the sum of squares in a step, over the variance of the noise
FLOOR = 1e-7  # σ over the largest measured displacement, at least
SINGULAR = 1e-10
FARTHEST = 3.0  # step over the size of a change that matters


@dataclass(frozen=True)
class Model:
    """What is measured for some parameters.

    Attributes
    ----------
    value : callable
        θ, (p,) → (h(θ), (m, d); a state that `slopes` takes).
    slopes : callable
        (θ, state) → ∂h/∂θ, (m, d, p).
    """

    value: Callable[[Array], tuple[Array, Array]]
    slopes: Callable[[Array, Array], Array]


@dataclass(frozen=True)
class Fit:
    """The parameters found.

    Attributes
    ----------
    theta : array, (p,)
    covariance : array, (p, p)
    sigma : float
        Standard deviation of the noise of a component.
    counts : array of bool, (m,)
        False of rows that are left out.
    lengths : array, (m,)
        |y − h(θ)| of all rows.
    freedom : int or None
        n − p; None if σ was given.
    state : array
        That of the model.
    """

    theta: Array
    covariance: Array
    sigma: float
    counts: NDArray[np.bool_]
    lengths: Array
    freedom: int | None
    state: Array

    def half_width(self, level: float) -> float:
        """Half width of the interval of a probability, over the standard deviation."""
        tail = (1 + level) / 2
        return float(norm.ppf(tail) if self.freedom is None else t.ppf(tail, self.freedom))


def fit(model: Model, measured: Array, begin: Array, scale: Array, sigma: float | None) -> Fit:
    """Find the parameters.

    Parameters
    ----------
    model : Model
    measured : array, (m, d)
    begin, scale : array, (p,)
        Where the search begins, and sizes of changes that matter.
    sigma : float, optional
        Standard deviation of the noise of a component.

    Raises
    ------
    WorkError
        If the data do not determine the parameters, or no minimum is found.
    """
    size = float(np.abs(measured).max()) or 1.0
    theta, counts = begin, np.ones(len(measured), dtype=bool)

    def weigh(off: Array) -> Array:
        return cauchy(np.linalg.norm(off, axis=1) / np.sqrt(off.shape[1]), sigma, FLOOR * size)

    value, state = model.value(theta)
    begun = value, state, theta, model.slopes(theta, state)
    value, state, theta, slopes = descend(model, measured, begun, scale, weigh)
    for number in range(ROUNDS):
        off = measured - value
        noise = estimated(off, counts, len(theta), size) if sigma is None else sigma
        wild = np.linalg.norm(off, axis=1) > WILD * noise * np.sqrt(off.shape[1])
        if np.array_equal(~wild, counts) and number > 0:
            break
        counts = ~wild
        if counts.sum() * off.shape[1] <= len(theta):
            raise WorkError("the markers disagree with each other: no state fits most of them")
        at, kept = (value, state, theta, slopes), partial(constant, counts.astype(float))
        value, state, theta, slopes = descend(model, measured, at, scale, kept)
    off = (measured - value)[counts]
    freedom = off.size - len(theta)
    noise = sigma or max(float(np.sqrt((off**2).sum() / max(freedom, 1))), FLOOR * size)
    jacobian = slopes[counts].reshape(-1, len(theta))
    covariance = noise**2 * inverse(jacobian.T @ jacobian, scale)
    return Fit(
        theta,
        covariance,
        noise,
        counts,
        np.linalg.norm(measured - value, axis=1),
        None if sigma is not None else freedom,
        state,
    )


def wild_cost(lengths: Array, sigma: float) -> float:
    """Sum of squares over the variance; wild rows count for a constant."""
    return float((np.minimum(lengths / sigma, WILD) ** 2).sum())


def stepped(
    best: Fit, measured: Array, theta: Array, value: Array, slopes: Array, scale: Array
) -> Fit:
    """Take one Gauss–Newton step from other parameters, with the rows and the noise of a fit.

    Parameters
    ----------
    best : Fit
    measured : array, (m, d)
    theta, scale : array, (p,)
    value : array, (m, d)
        h(θ).
    slopes : array, (m, d, p)

    Returns
    -------
    Fit
        Of the linear model around θ, whose state is the step, (p,).

    Raises
    ------
    WorkError
        If the data do not determine the parameters.
    """
    jacobian = slopes[best.counts].reshape(-1, len(theta))
    inverted = inverse(jacobian.T @ jacobian, scale)
    step = inverted @ (jacobian.T @ (measured - value)[best.counts].ravel())
    return replace(
        best,
        theta=theta + step,
        covariance=best.sigma**2 * inverted,
        lengths=np.linalg.norm(measured - value - slopes @ step, axis=1),
        state=step,
    )


def cauchy(length: Array, sigma: float | None, floor: float) -> Array:
    """Weights of rows by |y − h| over √d: (…, m) → same; without σ by their median."""
    scale = sigma or np.maximum(1.4826 * np.median(length, axis=-1, keepdims=True), floor)
    return np.asarray(1 / (1 + (length / (CAUCHY * scale)) ** 2))


def constant(weights: Array, off: Array) -> Array:
    """Weights that do not depend on how far rows are off."""
    return weights


def estimated(off: Array, counts: NDArray[np.bool_], parameters: int, size: float) -> float:
    """Standard deviation of a component, from the rows that count."""
    length = np.linalg.norm(off[counts], axis=1) / np.sqrt(off.shape[1])
    share = max(1 - parameters / (counts.sum() * off.shape[1]), 0.1)
    return max(float(np.median(length)) * 1.15 / np.sqrt(share), FLOOR * size)


def descend(
    model: Model,
    measured: Array,
    at: tuple[Array, Array, Array, Array],
    scale: Array,
    weigh: Callable[[Array], Array],
) -> tuple[Array, Array, Array, Array]:
    """Gauss–Newton steps from values, a state, parameters and slopes; returns the same."""
    (value, state, theta, slopes), damping = at, 0.0
    floor = FLOOR * (float(np.abs(measured).max()) or 1.0)
    for _ in range(STEPS):
        off = measured - value
        weights = weigh(off)
        rows = np.sqrt(weights)[:, None, None] * slopes
        jacobian = rows.reshape(-1, len(theta)) * scale
        normal = jacobian.T @ jacobian
        gradient = jacobian.T @ (np.sqrt(weights)[:, None] * off).ravel()
        cost = float((weights[:, None] * off**2).sum())
        while True:
            damped = normal + damping * np.diag(np.diag(normal))
            step = inverse(damped, np.ones(len(theta))) @ gradient
            step = scale * step * min(1.0, FARTHEST / max(float(np.abs(step).max()), 1e-300))
            trial, its = model.value(theta + step)
            after = float((weights[:, None] * (measured - trial) ** 2).sum())
            if np.isfinite(after) and after <= cost * (1 + 1e-9):
                break
            damping = max(4 * damping, 1e-3)
            if damping > 1e8:
                return value, state, theta, slopes
        variance = max(after / max(measured.size - len(theta), 1), floor**2)
        theta, value, state, damping = theta + step, trial, its, damping / 10
        slopes = model.slopes(theta, state)
        if cost - after < SETTLED * variance:
            return value, state, theta, slopes
    raise WorkError(
        f"no state that fits the markers is found within {STEPS} steps: they may not tell all "
        "that is sought"
    )


def inverse(normal: Array, scale: Array) -> Array:
    """Inverse of JᵀJ; WorkError if the data do not determine all parameters."""
    scaled = normal * np.outer(scale, scale)
    sizes = np.sqrt(np.diag(scaled))
    if not np.isfinite(scaled).all() or sizes.min() <= 0:
        raise WorkError("the markers do not tell all that is sought: some of it moves none of them")
    alike = scaled / np.outer(sizes, sizes)
    if np.linalg.eigvalsh(alike)[0] < SINGULAR:
        raise WorkError("the markers do not tell all that is sought: parts of it move them alike")
    found = np.linalg.inv(alike) / np.outer(sizes, sizes)
    return np.asarray(found * np.outer(scale, scale))
