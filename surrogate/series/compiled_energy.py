r"""The least potential energy under one load, compiled: `surrogate.series.least_energy`.

The derivatives are those at the points, where :math:`∂e/∂c_k = \mathrm{cof} F : H_k` and
:math:`∂^2 e / ∂c_k ∂c_l = F : (H_k × H_l)`, in the plane :math:`I : (H_k × H_l)`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surrogate.series.compiled_fields import (
    Array,
    add_contraction,
    add_cross_product,
    add_linear_cofactors,
    add_multiple,
    add_trace,
    compiled,
    product_of,
    rough_product,
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

Doubles = NDArray[np.float64]


class Potential(NamedTuple):
    """What Π(c) is made of: `surrogate.series.least_energy.EnergyOfTerms`.

    Attributes
    ----------
    h : array, (n_rows, n, d, d, n_points)
        Hₖ, in rows of points.
    volumes : array, (n_rows, n_points)
    squares, works : array, (n, n), (n,)
        μ M and a.
    factors : Factors
    """

    h: Array
    volumes: Array
    squares: Doubles
    works: Doubles
    factors: Factors


@compiled
def potential_of_terms(h: Array, volumes: Array, factors: Factors) -> Potential:
    """Make Π of Hₖ, (n_rows, n, d, d, n_points), and volumes, (n_rows, n_points)."""
    mu, growth, decay = factors
    rows, n, d, _, points = h.shape
    squares, works = np.zeros((n, n)), np.zeros(n)
    weighted, trace = np.empty((d, d, points), h.dtype), np.empty(points, h.dtype)
    of_trace, of_turned = h.dtype.type(growth + decay), h.dtype.type(-mu)
    for row in range(rows):
        part, weights = h[row], volumes[row]
        for k in range(n):
            for i in range(d):
                for j in range(d):
                    for q in range(points):
                        weighted[i, j, q] = weights[q] * part[k, i, j, q]
            for i in range(k + 1):
                squares[k, i] += mu * rough_product(weighted.ravel(), part[i].ravel())
            if k == 0:
                trace[:] = 0
                add_trace(1.0, weighted, trace)
                stress = np.zeros_like(weighted)
                add_linear_cofactors(weighted, stress)
                for i in range(d):
                    for j in range(d):
                        for q in range(points):
                            stress[i, j, q] *= of_turned
                    for q in range(points):
                        stress[i, i, q] += of_trace * trace[q]
            works[k] += rough_product(stress.ravel(), part[k].ravel())
    for k in range(n):
        for i in range(k):
            squares[i, k] = squares[k, i]
        works[k] += squares[0, k]
    return Potential(h, volumes, squares, works, factors)


@compiled
def energy_at(c: Doubles, potential: Potential, gradient: Doubles, hessian: Doubles) -> float:
    """Return Π, and write its derivatives; +∞ without them where J is not positive at a point.

    Parameters
    ----------
    c : array, (n,)
    potential : Potential
    gradient, hessian : array, (n,), (n, n)
        Output; of the Hessian, the lower half.
    """
    h, volumes, squares, works, factors = potential
    rows, n, d, _, points = h.shape
    number = h.dtype.type
    mu, growth, decay = number(factors.mu), number(factors.growth), number(factors.decay)
    f, cofactors = np.empty((d, d, points), h.dtype), np.empty((d, d, points), h.dtype)
    turned, first = np.empty((d, d, points), h.dtype), np.empty((n, points), h.dtype)
    scalars = np.empty((6, points), h.dtype)
    e, beyond, slope, curvature, pressure, change = (
        scalars[0],
        scalars[1],
        scalars[2],
        scalars[3],
        scalars[4],
        scalars[5],
    )
    energy = 0.0
    for k in range(n):
        straight = -works[k]
        for i in range(n):
            straight += squares[k, i] * c[i]
        for i in range(k + 1):
            hessian[k, i] = squares[k, i]
        gradient[k] = straight
        energy += c[k] * (straight - works[k]) / 2
    for row in range(rows):
        part, weights = h[row], volumes[row]
        f[:] = 0
        for k in range(n - 1, -1, -1):  # the largest last: rounding errors of c₁ H₁ are alike
            add_multiple(c[k], part[k].ravel(), f.ravel())
        cofactors[:] = 0  # without I
        scalars[:] = 0
        add_linear_cofactors(f, cofactors)
        if d == 3:  # e - tr H = (I × H) : H / 2 + det H
            add_contraction(1 / 6, f, cofactors, beyond)
            add_cross_product(0.5, f, f, cofactors)
            add_contraction(1 / 3, f, cofactors, beyond)
        else:
            add_contraction(0.5, f, cofactors, beyond)
        add_trace(1.0, f, e)
        least = e[0]
        for q in range(points):
            e[q] += beyond[q]
            least = min(least, e[q])
        if not least > SMALLEST_J - 1:
            return np.inf
        for q in range(points):
            of_point = float(e[q])
            logarithmic = decay * (of_point - math.log1p(of_point))
            energy += weights[q] * (logarithmic + growth * of_point**2 / 2 - mu * beyond[q])
        for q in range(points):
            inverse = 1 / (1 + e[q])
            slope[q] = weights[q] * e[q] * (growth + decay * inverse)
            curvature[q] = weights[q] * (growth + decay * inverse * inverse)
            pressure[q] = slope[q] - mu * weights[q]
        for i in range(d):
            for q in range(points):
                f[i, i, q] += 1
            for j in range(d):
                for q in range(points):
                    f[i, j, q] *= pressure[q]
        for k in range(n):
            change[:] = 0
            add_contraction(1.0, cofactors, part[k], change)
            gradient[k] -= mu * product_of(change, weights)
            add_trace(1.0, part[k], change)
            gradient[k] += product_of(change, slope)
            turned[:] = 0
            if d == 3:
                add_cross_product(1.0, f, part[k], turned)
            else:
                add_linear_cofactors(part[k], turned)
                for i in range(d):
                    for j in range(d):
                        for q in range(points):
                            turned[i, j, q] *= pressure[q]
            for q in range(points):
                first[k, q] = change[q]
                change[q] *= curvature[q]
            for i in range(k + 1):
                hessian[k, i] += rough_product(turned.ravel(), part[i].ravel())
                hessian[k, i] += rough_product(change, first[i])
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
    """Return the coefficients of the least Π, (n,).

    Parameters
    ----------
    potential : Potential
    rounding : float
        Relative rounding of a number in the precision of the fields.
    """
    squares = potential.squares
    n, number = len(squares), potential.h.dtype.type  # with other c than the fields', Π is rough
    scale, c, trial = np.empty(n), np.ones(n), np.ones(n)
    for k in range(n):
        scale[k] = (squares[k, k] + rounding**2 * squares[0, 0] + TINY) ** -0.5
        if k > 0:
            ratio = squares[k, k] / (squares[k - 1, k - 1] + TINY)
            c[k] = number(c[k - 1] / (1 + ratio * ratio))
    gradient, hessian, step = np.empty(n), np.empty((n, n)), np.empty(n)
    new_gradient, new_hessian = np.empty(n), np.empty((n, n))
    energy, shift = energy_at(c, potential, gradient, hessian), SMALLEST_SHIFT
    for _ in range(EVALUATIONS):
        if energy == np.inf:
            for k in range(n):
                c[k] = number(c[k] * 0.5 ** (k + 1))
            energy = energy_at(c, potential, gradient, hessian)
            continue
        newton_step(gradient, hessian, scale, shift, step)
        size = 0.0
        for k in range(n):
            size += step[k] ** 2
            trial[k] = number(c[k] - scale[k] * step[k])
        small = SMALL_STEP * abs(c[n - 1] / scale[n - 1]) + max(SMALLEST_STEP, rounding) / scale[0]
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
