r"""The combination of the terms of a series that has the least potential energy, compiled.

.. math::
    u = \sum_{k=1}^n c_k u_k, \qquad Π(c) = E(u) - f · u \to \min, \qquad
    \frac{∂Π}{∂c_k} = \sum_q w_q P_q : H_{k,q} - a_k, \quad a_k = f · u_k

with :math:`F = I + E`, :math:`E = \sum_k c_k H_k`, and the derivatives of the energy by its
measures (`surrogate.mechanics.solids.deformation`). Nothing is lost where the gradients are small:
with :math:`C = \mathrm{cof} F - I` and :math:`s = 2 ψ_1 + 4 ψ_2 + ψ_J`, which is zero at rest,

.. math::
    P = 2 ψ_1 (E - C) + 2 ψ_2 (\mathrm{cof} F × F - 2 \, \mathrm{cof} F) + s (I + C).

Scalars are in double precision, and tensors in that of the gradients. The works aₖ are those of the
stress that is linear in H₁, since f = K u₁.

Newton's method minimises Π, from terms that fade where they do not decrease, under half of the load
as long as Π is infinite there. A step that raises Π is not taken; the next one is tried with a
larger shift of the Hessian (Levenberg, Marquardt).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surrogate.mechanics.compiled.cells import Cells
from surrogate.mechanics.compiled.fields import (
    Array,
    add_contraction,
    add_cross_product,
    add_linear_cofactors,
    add_multiple,
    add_trace,
    inner,
    product_of,
    rough_product,
)
from surrogate.mechanics.compiled.tapes import Tapes, values_of
from surrogate.mechanics.series.compiled_laws import I1, I2, INPUTS, THETA, J, Laws

Doubles = NDArray[np.float64]
EVALUATIONS = 30  # of Π, at most
SMALLEST_SHIFT, SECOND_SHIFT, GROWTH = 1e-9, 1e-3, 10.0  # relative to the stiffness of every term
SMALLEST_J = 1e-6
ROUNDING = 2.0**12  # of Π, relative, in units of the rounding of a number
SMALL_STEP, SMALLEST_STEP = 3e-3, 1e-10  # relative to the last term, and to the first one
TINY = 1e-60  # no division by zero; energies are those of volumes of about 1


class Potential(NamedTuple):
    """What Π(c) is made of.

    Attributes
    ----------
    h : array, (n_rows, n, d, d, n_points)
        Hₖ, in rows of points.
    cells : Cells
    laws : Laws
    squares : array, (n, n)
        Σ w μ Hₖ : Hₗ, with the shear modulus at rest.
    works : array, (n,)
        a.
    at_rest : array, (n_laws,)
        Energy density of the undeformed body.
    """

    h: Array
    cells: Cells
    laws: Laws
    squares: Doubles
    works: Doubles
    at_rest: Doubles


@inner
def potential_of_terms(h: Array, cells: Cells, laws: Laws, moduli: Doubles) -> Potential:
    """Make Π of Hₖ, (n_rows, n, d, d, n_points).

    Parameters
    ----------
    h : array
    cells : Cells
    laws : Laws
    moduli : array, (3, n_laws)
        λ and μ at rest, and the energy density there.
    """
    rows, n, d, _, points = h.shape
    squares, works = np.zeros((n, n)), np.zeros(n)
    stress, trace = np.empty((d, d, points), h.dtype), np.empty(points, h.dtype)
    real = h.dtype.type
    points_of_cell = cells.gradients.shape[1]
    for row in range(rows):
        part, weights = h[row], cells.volumes[row]
        number = cells.laws[row // points_of_cell]
        lam, mu = real(moduli[0, number]), real(moduli[1, number])
        for k in range(n):
            for i in range(d):
                for j in range(d):
                    for q in range(points):
                        stress[i, j, q] = mu * weights[q] * part[k, i, j, q]
            for i in range(k + 1):
                squares[k, i] += rough_product(stress.ravel(), part[i].ravel())
        trace[:] = 0  # σ = λ tr ε I + 2 μ ε
        add_trace(1.0, part[0], trace)
        for i in range(d):
            for j in range(d):
                for q in range(points):
                    stress[i, j, q] = mu * weights[q] * (part[0, i, j, q] + part[0, j, i, q])
            for q in range(points):
                stress[i, i, q] += lam * weights[q] * trace[q]
        for k in range(n):
            works[k] += rough_product(stress.ravel(), part[k].ravel())
    for k in range(n):
        for i in range(k):
            squares[i, k] = squares[k, i]
    return Potential(h, cells, laws, squares, works, moduli[2])


@inner
def energy_at(c: Doubles, potential: Potential, gradient: Doubles, hessian: Doubles) -> float:
    """Return Π, and write its derivatives; +∞ without them where J is not positive at a point.

    Parameters
    ----------
    c : array, (n,)
    potential : Potential
    gradient, hessian : array, (n,), (n, n)
        Output; of the Hessian, the lower half.
    """
    h, cells, laws = potential.h, potential.cells, potential.laws
    rows, n, d, _, points = h.shape
    per_cell, tapes = cells.gradients.shape[1], laws.energy
    kind, _real = h.dtype, h.dtype.type
    e, cof = np.empty((d, d, points), kind), np.empty((d, d, points), kind)
    stress, turned = np.empty((d, d, points), kind), np.empty((d, d, points), kind)
    mixed, extra = np.empty((d, d, points), kind), np.empty((d, d, points), kind)
    trace, beyond, square, change = (
        np.empty(points, kind),
        np.empty(points, kind),
        np.empty(points, kind),
        np.empty(points, kind),
    )
    weighted, opposite = np.empty((d, d, points), kind), np.empty((d, d, points), kind)
    first, curved = np.empty((3, points), kind), np.empty((3, 3, points), kind)
    changes = np.empty((n, 3, points), kind)
    pairs, is_used = np.empty((3, 3), np.bool_), np.empty(3, np.bool_)
    slots = np.empty((INPUTS + tapes.codes.shape[1], points))
    energy = 0.0
    gradient[:], hessian[:] = 0, 0
    for k in range(n):
        gradient[k] = -potential.works[k]
        energy -= c[k] * potential.works[k]
    for row in range(rows):
        part, weights = h[row], cells.volumes[row]
        number = cells.laws[row // per_cell]
        second = d == 3 and laws.second_is[number]
        e[:] = 0
        for k in range(n - 1, -1, -1):  # the largest last: rounding errors of c₁ H₁ are alike
            add_multiple(c[k], part[k].ravel(), e.ravel())
        cof[:], trace[:], beyond[:], square[:] = 0, 0, 0, 0
        add_linear_cofactors(e, cof)
        if d == 3:  # J - 1 - tr E = (I × E) : E / 2 + det E
            add_contraction(1 / 6, e, cof, beyond)
            add_cross_product(0.5, e, e, cof)
            add_contraction(1 / 3, e, cof, beyond)
        else:
            add_contraction(0.5, e, cof, beyond)
        add_trace(1.0, e, trace)
        add_contraction(1.0, e, e, square)
        least = np.inf
        for q in range(points):
            of_point = float(trace[q]) + float(beyond[q])
            slots[J, q] = 1 + of_point
            slots[I1, q] = 3 + 2 * float(trace[q]) + float(square[q])
            slots[THETA, q] = 1.0
            least = min(least, of_point)
        if not least > SMALLEST_J - 1:
            return np.inf
        if second:
            change[:] = 0
            add_contraction(1.0, cof, cof, change)
            square[:] = 0
            add_trace(2.0, cof, square)
            for q in range(points):
                slots[I2, q] = 3 + float(square[q]) + float(change[q])
        else:
            slots[I2, :] = 3.0
        values_of(number, tapes, slots)
        rest = potential.at_rest[number]
        energy += product_of(weights, slots[tapes.outputs[number, 0]])
        for q in range(points):
            energy -= rest * weights[q]
        if not energy < np.inf:  # no energy, or none that is a number
            return np.inf
        for a in range(3):
            _weighted(1 + a, number, tapes, slots, weights, first[a])
        for q in range(points):
            trace[q] = 2 * first[I1, q]
        _sum_of_first(number, tapes, slots, weights, second, beyond)
        if second:  # mixed = cof F × F - 2 cof F
            mixed[:] = 0
            add_linear_cofactors(cof, mixed)
            add_linear_cofactors(e, mixed)
            add_cross_product(1.0, cof, e, mixed)
            add_multiple(-2.0, cof.ravel(), mixed.ravel())
        for i in range(d):
            for j in range(d):
                for q in range(points):
                    stress[i, j, q] = (
                        trace[q] * (e[i, j, q] - cof[i, j, q]) + beyond[q] * cof[i, j, q]
                    )
                if second:
                    for q in range(points):
                        stress[i, j, q] += 2 * first[I2, q] * mixed[i, j, q]
            for q in range(points):
                stress[i, i, q] += beyond[q]
        for k in range(n):
            gradient[k] += rough_product(stress.ravel(), part[k].ravel())
        for i in range(d):  # F and cof F take the place of E and C
            for q in range(points):
                e[i, i, q] += 1
                cof[i, i, q] += 1
        for i in range(d):
            for j in range(d):
                if second:
                    for q in range(points):
                        mixed[i, j, q] += 2 * cof[i, j, q]
                if d == 3:  # J's part of the Hessian is a product with ψ_J F
                    for q in range(points):
                        weighted[i, j, q] = first[J, q] * e[i, j, q]
        for a in range(3):
            is_used[a] = False
            for b in range(3):
                pairs[a, b] = _is_pair(tapes, number, a, b) and (second or (a != I2 and b != I2))
                is_used[a] |= pairs[a, b]
                if pairs[a, b] and b <= a:
                    _weighted(pair(a, b), number, tapes, slots, weights, curved[a, b])
        for k in range(n):
            if is_used[I1]:
                changes[k, I1] = 0
                add_contraction(2.0, e, part[k], changes[k, I1])
            if is_used[I2]:
                changes[k, I2] = 0
                add_contraction(2.0, mixed, part[k], changes[k, I2])
            if is_used[J]:
                changes[k, J] = 0
                add_contraction(1.0, cof, part[k], changes[k, J])
            turned[:] = 0
            if d == 3:
                add_cross_product(1.0, weighted, part[k], turned)
            else:
                add_linear_cofactors(part[k], turned)
                for i in range(d):
                    for j in range(d):
                        for q in range(points):
                            turned[i, j, q] *= first[J, q]
            if second:
                extra[:] = 0
                opposite[:] = 0
                add_cross_product(1.0, e, part[k], opposite)
                add_cross_product(1.0, opposite, e, extra)
                add_cross_product(1.0, cof, part[k], extra)
                for i in range(d):
                    for j in range(d):
                        for q in range(points):
                            turned[i, j, q] += 2 * first[I2, q] * extra[i, j, q]
            for i in range(d):
                for j in range(d):
                    for q in range(points):
                        turned[i, j, q] += trace[q] * part[k, i, j, q]
            for i in range(k + 1):
                hessian[k, i] += rough_product(turned.ravel(), part[i].ravel())
            for a in range(3):
                if not is_used[a]:
                    continue
                change[:] = 0
                for b in range(3):
                    if pairs[a, b]:
                        factor, by = curved[max(a, b), min(a, b)], changes[k, b]
                        for q in range(points):
                            change[q] += factor[q] * by[q]
                for i in range(k + 1):
                    hessian[k, i] += rough_product(change, changes[i, a])
    return energy


@inner
def _weighted(
    output: int, number: int, tapes: Tapes, slots: Doubles, weights: Array, out: Array
) -> None:
    """Write an output of a tape times the volumes of the points."""
    place = tapes.outputs[number, output]
    if place < 0:
        factor = out.dtype.type(tapes.fixed[number, output])
        for q in range(len(out)):
            out[q] = factor * weights[q]
    else:
        values = slots[place]
        for q in range(len(out)):
            out[q] = weights[q] * values[q]


@inner
def _sum_of_first(
    number: int, tapes: Tapes, slots: Doubles, weights: Array, second: bool, out: Array
) -> None:
    """Write s times the volumes of the points; its parts cancel at rest, in double precision."""
    total = slots[THETA]  # which nothing needs any more
    total[:] = 0
    for a in range(3):
        factor, place = (2.0, 4.0, 1.0)[a], tapes.outputs[number, 1 + a]
        if a == I2 and not second:
            continue
        if place < 0:
            total += factor * tapes.fixed[number, 1 + a]
        else:
            values = slots[place]
            for q in range(len(out)):
                total[q] += factor * values[q]
    for q in range(len(out)):
        out[q] = weights[q] * total[q]


@inner
def pair(a: int, b: int) -> int:
    """Number of the output that is the second derivative by I₁, I₂ or J, and one of them."""
    low, high = min(a, b), max(a, b)
    count = 4
    return 1 + count + low * count - low * (low - 1) // 2 + high - low


@inner
def _is_pair(tapes: Tapes, number: int, a: int, b: int) -> bool:
    """Whether a second derivative is not zero."""
    output = pair(a, b)
    return tapes.outputs[number, output] >= 0 or tapes.fixed[number, output] != 0


@inner
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


@inner
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
