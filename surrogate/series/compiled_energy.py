r"""The least potential energy under one load, compiled: `surrogate.series.least_energy`.

The coefficients begin with :math:`c_0 = 1` here, as in `surrogate.series.jacobian`.
"""

from __future__ import annotations

import math
from functools import cache
from itertools import combinations_with_replacement
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from shared_schema.material import NeoHookean
from surrogate.series.compiled_fields import (
    Array,
    add_contraction,
    add_cross_product,
    add_linear_cofactors,
    add_trace,
    compiled,
    integral,
)
from surrogate.series.least_energy import (
    EVALUATIONS,
    GROWTH,
    ROUNDING,
    SECOND_SHIFT,
    SMALL_STEP,
    SMALLEST_J,
    SMALLEST_SHIFT,
    SMALLEST_STEP,
    TINY,
)
from surrogate.series.stress_series import Factors

AT_ONCE = 1024  # quadrature points whose fields are in the cache together
Doubles = NDArray[np.float64]


class Potential(NamedTuple):
    """What Π(c) is made of: the attributes of `EnergyOfTerms`, by their names there.

    Attributes
    ----------
    indices : array of int, (n_monomials, d)
        Numbers of the factors c of every monomial.
    coefficients : array, (n_monomials, n_points)
        Jₘ.
    squares, works, nonlinear : array, (n, n), (n,), (n_monomials,)
    square, excess : array, (n_points,)
    """

    indices: NDArray[np.int64]
    coefficients: Array
    squares: Doubles
    works: Doubles
    nonlinear: Doubles
    square: Array
    excess: Array


@cache
def monomials(order: int, degree: int) -> NDArray[np.int64]:
    """Numbers of the factors of every monomial but the first: (n_monomials, d)."""
    return np.array(list(combinations_with_replacement(range(order + 1), degree))[1:])


def potential_of_terms(material: NeoHookean, volumes: Array, h: Array) -> Potential:
    """Make Π of Hₖ, (n, d, d, n_points), and volumes, (n_points,), of one precision."""
    mu, growth, decay = Factors.of(material)
    both = material.lame_lambda + mu  # growth + decay, not rounded twice
    return _potential(h, volumes, monomials(*h.shape[:2]), mu, growth, decay, both)


@compiled
def jacobian_coefficients(h: Array, count: int) -> Array:
    """Jₘ of Hₖ, in the order of `monomials`: (n, d, d, n_points) → (n_monomials, n_points)."""
    n, d = h.shape[:2]
    out = np.zeros((count, h.shape[3]), h.dtype)
    product = np.zeros_like(h[0])
    m = n
    for k in range(n):
        add_trace(1.0, h[k], out[k])
        product[:] = 0
        add_linear_cofactors(h[k], product)
        for i in range(k, n):
            add_contraction(0.5 if i == k else 1.0, product, h[i], out[m])
            m += 1
    if d == 3:
        for k in range(n):
            for i in range(k, n):
                product[:] = 0
                add_cross_product(0.5 if i == k else 1.0, h[k], h[i], product)
                for p in range(i, n):
                    times = 3.0 if k == p else 2.0 if i == p else 1.0
                    add_contraction(1.0 / times, product, h[p], out[m])
                    m += 1
    return out


@compiled
def _potential(
    h: Array,
    volumes: Array,
    indices: NDArray[np.int64],
    mu: float,
    growth: float,
    decay: float,
    both: float,
) -> Potential:
    n, d, _, points = h.shape
    count, number = len(indices), h.dtype.type
    coefficients = np.empty((count, points), h.dtype)
    squares, works, nonlinear = np.zeros((n, n)), np.zeros(n), np.zeros(count)
    for start in range(0, points, AT_ONCE):
        part = np.ascontiguousarray(h[:, :, :, start : start + AT_ONCE])
        weights = volumes[start : start + AT_ONCE]
        jacobian, ones = jacobian_coefficients(part, count), np.ones_like(weights)
        coefficients[:, start : start + AT_ONCE] = jacobian
        for m in range(n, count):
            nonlinear[m] += mu * integral(jacobian[m], ones, weights)
        for k in range(n):
            for i in range(k + 1):
                for a in range(d):
                    for b in range(d):
                        squares[k, i] += mu * integral(part[k, a, b], part[i, a, b], weights)
            works[k] += both * integral(jacobian[0], jacobian[k], weights)
    for k in range(n):
        for i in range(k):
            squares[i, k] = squares[k, i]
        works[k] += squares[0, k] - (2.0 if k == 0 else 1.0) * nonlinear[n + k]
    square, excess = number(growth) * volumes, number(decay) * volumes
    return Potential(indices, coefficients, squares, works, nonlinear, square, excess)


@compiled
def energy_at(c: Doubles, potential: Potential, gradient: Doubles, hessian: Doubles) -> float:
    """Return Π, and write its derivatives; +∞ without them where J is not positive at a point.

    Parameters
    ----------
    c : array, (n + 1,)
    potential : Potential
    gradient, hessian : array, (n,), (n, n)
        Output; of the Hessian, the lower half.
    """
    indices, coefficients, squares, works, nonlinear, square, excess = potential
    n, (count, points), d = len(works), coefficients.shape, indices.shape[1]
    values, slopes = np.empty(count), np.zeros((n, count))
    for m in range(count):
        values[m] = 1.0
        for a in range(d):
            values[m] *= c[indices[m, a]]
            others = 1.0
            for b in range(d):
                if b != a:
                    others *= c[indices[m, b]]
            if indices[m, a] > 0:
                slopes[indices[m, a] - 1, m] += others
    e, first = np.zeros_like(square), np.zeros((n, points), square.dtype)
    for m in range(count):
        factor = square.dtype.type(values[m])
        for q in range(points):
            e[q] += factor * coefficients[m, q]
    least = e[0]
    for q in range(points):
        least = min(least, e[q])
    if not least > SMALLEST_J - 1:
        return np.inf
    for m in range(count):
        for k in range(n):
            if slopes[k, m] != 0:
                factor = square.dtype.type(slopes[k, m])
                for q in range(points):
                    first[k, q] += factor * coefficients[m, q]
    energy = 0.0
    for q in range(points):
        of_point = float(e[q])
        energy += (of_point - math.log1p(of_point)) * excess[q] + square[q] * of_point**2 / 2
    weights, second = np.empty_like(e), np.empty_like(e)
    for q in range(points):
        inverse = 1 / (1 + e[q])
        logarithmic = inverse * excess[q]
        weights[q] = logarithmic + square[q]
        second[q] = logarithmic * inverse + square[q]
    for k in range(n):
        straight = -works[k]
        for i in range(n):
            straight += squares[k, i] * c[i + 1]
        for i in range(k + 1):
            hessian[k, i] = squares[k, i] + integral(first[k], first[i], second)
        gradient[k] = straight
        energy += c[k + 1] * (straight - works[k]) / 2
    for m in range(count):
        energy -= values[m] * nonlinear[m]
        force = integral(coefficients[m], e, weights) - nonlinear[m]
        for k in range(n):
            gradient[k] += slopes[k, m] * force
        for a in range(d):
            for b in range(d):
                k, i = indices[m, a] - 1, indices[m, b] - 1
                if a != b and k >= i >= 0:
                    other = c[indices[m, 3 - a - b]] if d == 3 else 1.0
                    hessian[k, i] += force * other
    return energy


@compiled
def newton_step(
    gradient: Doubles, hessian: Doubles, scale: Doubles, shift: float, step: Doubles
) -> None:
    """Write the step of Newton's method in units of `scale`, by the lower half of the Hessian."""
    n = len(step)
    matrix = np.empty((n, n))
    for k in range(n):
        step[k] = gradient[k] * scale[k]
        for i in range(k + 1):
            matrix[k, i] = hessian[k, i] * scale[k] * scale[i]
        matrix[k, k] += shift
    for p in range(n):  # eliminate; the lower half is that of the rest, the upper one is unused
        for k in range(p + 1, n):
            factor = matrix[k, p] / matrix[p, p]
            step[k] -= factor * step[p]
            for i in range(p + 1, k + 1):
                matrix[k, i] -= factor * matrix[i, p]
    for p in range(n - 1, -1, -1):
        for k in range(p + 1, n):
            step[p] -= matrix[k, p] * step[k]
        step[p] /= matrix[p, p]


@compiled
def least_energy(potential: Potential, rounding: float) -> Doubles:
    """Return the coefficients of the least Π, (n + 1,).

    Parameters
    ----------
    potential : Potential
    rounding : float
        Relative rounding of a number in the precision of the fields.
    """
    squares = potential.squares
    n = len(squares)
    scale, c, trial = np.empty(n), np.ones(n + 1), np.ones(n + 1)
    for k in range(n):
        scale[k] = (squares[k, k] + rounding**2 * squares[0, 0] + TINY) ** -0.5
        if k > 0:
            ratio = squares[k, k] / (squares[k - 1, k - 1] + TINY)
            c[k + 1] = c[k] / (1 + ratio * ratio)
    gradient, hessian, step = np.empty(n), np.empty((n, n)), np.empty(n)
    new_gradient, new_hessian = np.empty(n), np.empty((n, n))
    energy, shift = energy_at(c, potential, gradient, hessian), SMALLEST_SHIFT
    for _ in range(EVALUATIONS):
        if energy == np.inf:
            for k in range(1, n + 1):
                c[k] *= 0.5**k
            energy = energy_at(c, potential, gradient, hessian)
            continue
        newton_step(gradient, hessian, scale, shift, step)
        size = 0.0
        for k in range(n):
            size += step[k] ** 2
            trial[k + 1] = c[k + 1] - scale[k] * step[k]
        small = SMALL_STEP * abs(c[n] / scale[n - 1]) + max(SMALLEST_STEP, rounding) / scale[0]
        if shift == SMALLEST_SHIFT and size <= small * small:
            return trial  # the next step is of the order of the square
        new_energy = energy_at(trial, potential, new_gradient, new_hessian)
        if new_energy <= energy + ROUNDING * rounding * abs(energy):
            energy, shift = new_energy, SMALLEST_SHIFT
            c, trial = trial, c
            gradient, new_gradient = new_gradient, gradient
            hessian, new_hessian = new_hessian, hessian
        else:
            shift = max(GROWTH * shift, SECOND_SHIFT)
    return c
