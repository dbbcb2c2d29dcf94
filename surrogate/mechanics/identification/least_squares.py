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

The body itself may be another one than the model's, as that of a finer mesh is softer. With a
*model error* s, the displacements are :math:`(1 + ε) u(θ)` everywhere, with one ε of standard
deviation s. So the discrepancies of the markers are wholly correlated,

.. math:: \mathrm{cov} \, y = σ^2 I + s^2 h h^T, \qquad C = σ^2 (J^T J)^{-1} + s^2 g g^T,
          \qquad g = (J^T J)^{-1} J^T h,

and no number of markers makes them less (Kennedy and O'Hagan 2001, *J. R. Stat. Soc.* B63, with
a discrepancy of one mode). Where one force is sought, its relative error is s.
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
ROUGHLY = 0.1  # the same, while wild rows are told from others
FLOOR = 1e-7  # σ over the largest measured displacement, at least
SINGULAR = 1e-10
DAMPED = 1e-3  # damping after the first step that is too long, of the diagonal of JᵀJ
FARTHEST = 3.0  # step over the size of a change that matters


@dataclass(frozen=True)
class Model:
    """What is measured for some parameters: h(θ) = seen(u(θ)).

    Attributes
    ----------
    state : callable
        θ, (p,) → u(θ).
    slopes : callable
        (θ, u(θ)) → ∂u/∂θ, (…, p).
    seen : callable
        Linear: u → h, (m, d); ∂u/∂θ → ∂h/∂θ, (m, d, p).
    """

    state: Callable[[Array], Array]
    slopes: Callable[[Array, Array], Array]
    seen: Callable[[Array], Array]

    def at(self, theta: Array, state: Array, slopes: Array) -> Point:
        """Return what is measured of a state and its slopes."""
        return Point(theta, state, slopes, self.seen(state), self.seen(slopes))

    def around(self, theta: Array) -> Point:
        """Return what is measured around some parameters."""
        state = self.state(theta)
        return self.at(theta, state, self.slopes(theta, state))


@dataclass(frozen=True)
class Point:
    """Parameters, and what a model is there.

    Attributes
    ----------
    theta : array, (p,)
    state, slopes : array
        u(θ), and ∂u/∂θ there or at parameters beside θ that fit as well.
    value, jacobian : array, (m, d) and (m, d, p)
        Both at the markers: h(θ), ∂h/∂θ.
    """

    theta: Array
    state: Array
    slopes: Array
    value: Array
    jacobian: Array


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
    response : array, (p,)
        g: change of θ by the relative change of all displacements.
    freedom : int or None
        n − p; None if σ was given.
    state, slopes : array
        u(θ) and ∂u/∂θ of the model.
    """

    theta: Array
    covariance: Array
    sigma: float
    counts: NDArray[np.bool_]
    lengths: Array
    response: Array
    freedom: int | None
    state: Array
    slopes: Array

    def with_model_error(self, error: float) -> Array:
        """C with a model error, (p, p)."""
        return self.covariance + error**2 * np.outer(self.response, self.response)

    def variance(self, error: float) -> Array:
        """Variance of the field, of `state`'s shape: (1 + ε) u for a model error as well."""
        within = np.einsum("...p,pq,...q->...", self.slopes, self.covariance, self.slopes)
        return np.asarray(within + (error * (self.slopes @ self.response - self.state)) ** 2)

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
    floor = FLOOR * (float(np.abs(measured).max()) or 1.0)

    def weigh(off: Array) -> Array:
        return cauchy(np.linalg.norm(off, axis=1) / np.sqrt(off.shape[1]), sigma, floor)

    found = descend(model, measured, model.around(begin), scale, weigh, ROUGHLY)
    all_rows = np.ones(len(measured), dtype=bool)
    counts = that_count(measured - found.value, all_rows, len(begin), sigma, floor)
    return settled(model, measured, found, counts, scale, sigma)


def refit(
    model: Model,
    measured: Array,
    begin: Fit,
    state: Array,
    scale: Array,
    sigma: float | None,
) -> Fit:
    """Find the parameters from a fit of another model that is close, with the state there."""
    point = model.at(begin.theta, state, begin.slopes)
    return settled(model, measured, point, begin.counts, scale, sigma)


def settled(
    model: Model,
    measured: Array,
    point: Point,
    counts: NDArray[np.bool_],
    scale: Array,
    sigma: float | None,
) -> Fit:
    """Fit the rows that count, until these are those that are not wild; see `fit`."""
    parameters, floor = len(point.theta), FLOOR * (float(np.abs(measured).max()) or 1.0)
    for _ in range(ROUNDS):
        if counts.sum() * measured.shape[1] <= parameters:
            raise WorkError("the markers disagree with each other: no state fits most of them")
        weigh = partial(constant, counts.astype(float))
        point = descend(model, measured, point, scale, weigh, SETTLED)
        before = counts
        counts = that_count(measured - point.value, before, parameters, sigma, floor)
        if np.array_equal(before, counts):
            break
    off = measured - point.value
    freedom = off[counts].size - parameters
    noise = sigma or max(float(np.sqrt((off[counts] ** 2).sum() / max(freedom, 1))), floor)
    jacobian = point.jacobian[counts].reshape(-1, parameters)
    inverted = inverse(jacobian.T @ jacobian, scale)
    return Fit(
        theta=point.theta,
        covariance=noise**2 * inverted,
        response=inverted @ (jacobian.T @ point.value[counts].ravel()),
        sigma=noise,
        counts=counts,
        lengths=np.linalg.norm(off, axis=1),
        freedom=None if sigma is not None else freedom,
        state=point.state,
        slopes=point.slopes,
    )


def wild_cost(lengths: Array, sigma: float) -> float:
    """Sum of squares over the variance; wild rows count for a constant."""
    return float((np.minimum(lengths / sigma, WILD) ** 2).sum())


def stepped(best: Fit, measured: Array, point: Point, scale: Array) -> Fit:
    """Take one Gauss–Newton step from other parameters, with the rows and the noise of a fit.

    Parameters
    ----------
    best : Fit
    measured : array, (m, d)
    point : Point
        Where the step begins.
    scale : array, (p,)

    Returns
    -------
    Fit
        Of the linear model around the point.

    Raises
    ------
    WorkError
        If the data do not determine the parameters.
    """
    jacobian = point.jacobian[best.counts].reshape(-1, len(point.theta))
    inverted = inverse(jacobian.T @ jacobian, scale)
    step = inverted @ (jacobian.T @ (measured - point.value)[best.counts].ravel())
    return replace(
        best,
        theta=point.theta + step,
        covariance=best.sigma**2 * inverted,
        response=inverted
        @ (jacobian.T @ (point.value + point.jacobian @ step)[best.counts].ravel()),
        lengths=np.linalg.norm(measured - point.value - point.jacobian @ step, axis=1),
        state=point.state + point.slopes @ step,
        slopes=point.slopes,
    )


def cauchy(length: Array, sigma: float | None, floor: float) -> Array:
    """Weights of rows by |y − h| over √d: (…, m) → same; without σ by their median."""
    scale = sigma or np.maximum(1.4826 * np.median(length, axis=-1, keepdims=True), floor)
    return np.asarray(1 / (1 + (length / (CAUCHY * scale)) ** 2))


def constant(weights: Array, off: Array) -> Array:
    """Weights that do not depend on how far rows are off."""
    return weights


def that_count(
    off: Array, counted: NDArray[np.bool_], parameters: int, sigma: float | None, floor: float
) -> NDArray[np.bool_]:
    """Rows that are not wild; σ follows from those that counted before if it is not given."""
    length = np.linalg.norm(off, axis=1) / np.sqrt(off.shape[1])
    share = max(1 - parameters / (counted.sum() * off.shape[1]), 0.1)
    noise = sigma or max(float(np.median(length[counted])) * 1.15 / np.sqrt(share), floor)
    return np.asarray(length <= WILD * noise)


def descend(
    model: Model,
    measured: Array,
    point: Point,
    scale: Array,
    weigh: Callable[[Array], Array],
    small: float,
) -> Point:
    """Gauss–Newton steps, until one decreases the sum of squares by less than `small` variances.

    The slopes of the last point are those before that step.
    """
    parameters, damping = len(point.theta), 0.0
    floor = FLOOR * (float(np.abs(measured).max()) or 1.0)
    for _ in range(STEPS):
        off = measured - point.value
        weights = weigh(off)
        rows = np.sqrt(weights)[:, None, None] * point.jacobian
        jacobian = rows.reshape(-1, parameters) * scale
        normal = jacobian.T @ jacobian
        gradient = jacobian.T @ (np.sqrt(weights)[:, None] * off).ravel()
        cost = float((weights[:, None] * off**2).sum())
        while True:
            damped = normal + damping * np.diag(np.diag(normal))
            step = inverse(damped, np.ones(parameters)) @ gradient
            step = scale * step * min(1.0, FARTHEST / max(float(np.abs(step).max()), 1e-300))
            theta = point.theta + step
            state = model.state(theta)
            value = model.seen(state)
            after = float((weights[:, None] * (measured - value) ** 2).sum())
            if np.isfinite(after) and after <= cost * (1 + 1e-9):
                break
            damping = 4 * damping or DAMPED
            if damping > 1e8:
                return point
        variance = max(after / max(measured.size - parameters, 1), floor**2)
        if cost - after < small * variance:
            return replace(point, theta=theta, state=state, value=value)
        point, damping = model.at(theta, state, model.slopes(theta, state)), damping / 10
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
