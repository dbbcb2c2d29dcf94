r"""Energy in modes, its derivatives and its minimum, in loops that Numba compiles.

At every point, with the derivatives of the energy by its measures
(`surrogate.mechanics.energy.law`) and :math:`I_1' = 2 F`, :math:`J' = \mathrm{cof} F` and
:math:`I_2' = 2 \, \mathrm{cof} F × F`,

.. math::
    P = \sum_a ψ_a I_a', \qquad \frac{∂P}{∂F} : H = \sum_{a, b} ψ_{ab} \, (I_b' : H) \, I_a'
        + 2 ψ_1 H + ψ_J \, F × H + 2 ψ_2 (F × (F × H) + \mathrm{cof} F × H).

In the plane :math:`F_{33} = 1`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from surrogate.mechanics.compiled.fields import add_cross_product, compiled, product_of
from surrogate.mechanics.compiled.tapes import Tapes, values_of
from surrogate.mechanics.energy.law import Law
from surrogate.mechanics.series.compiled_laws import I1, I2, INPUTS, THETA, J, Laws
from surrogate.mechanics.series.compiled_weights import pair

SMALLEST_J = 1e-3
SUFFICIENT = 1e-4  # decrease of a step, over that of its slope (Armijo)
SHORTEST = 1e-2  # of a step, relative
ROUNDING = 1e-9  # of Π, relative to the stored energy
LEAST_CUT, HALF = 0.1, 0.5  # of a step that is shortened
RENEWED = 10  # steps after which the first inverse is computed again
FIRST_SHIFT, SHIFT_GROWTH = 0.1, 4.0  # relative to the stiffness at rest
FIRST = 1 + INPUTS  # outputs of an energy tape: the energy, its derivatives, the second ones
Doubles = NDArray[np.float64]
Singles = NDArray[np.float32]


class Points(NamedTuple):
    """Points of a cubature, with the modes of a body there.

    Attributes
    ----------
    slopes : array, (9 · n_points, m)
        Gradients of the modes in 1/m times the unit of a, row 3 i + j of every point.
    leading : array, (9 · n_points, k)
        Those of the first k modes.
    weights : array, (n_points,)
        In m³.
    laws : Laws
    first : Tapes
        Those of the energies, as far as the energy and its first derivatives.
    starts : array of int, (n_laws + 1,)
        First point of every law, then the number of points.
    """

    slopes: Singles
    leading: Singles
    weights: Doubles
    laws: Laws
    first: Tapes
    starts: NDArray[np.int64]


class Fields(NamedTuple):
    """Fields at the points of a cubature.

    Attributes
    ----------
    cof, mixed : array, (9, n_points)
        cof F, and cof F × F, which is zero where no energy depends on I₂.
    stress : array, (9, n_points)
        P times the weights of the points.
    values : array, (n, n_points)
        Outputs of the tapes of the energies, as many as wanted.
    """

    cof: Doubles
    stress: Singles
    mixed: Doubles
    values: Doubles


@compiled
def deformation(points: Points, a: Doubles) -> Doubles:
    """F at the points: (m,) → (9, n_points)."""
    f = (points.slopes @ a.astype(np.float32)).astype(np.float64)
    f = f.reshape(9, len(points.weights))
    for i in range(3):
        for q in range(f.shape[1]):
            f[4 * i, q] += 1
    return f


@compiled
def stress_of(points: Points, tapes: Tapes, f: Doubles, fields: Fields) -> bool:
    """Write the fields of F at the points, (9, n_points); False where J is not positive."""
    n = f.shape[1]
    cof, stress, mixed, values = fields
    space = (3, 3, n)
    cof[:], mixed[:] = 0, 0
    add_cross_product(0.5, f.reshape(space), f.reshape(space), cof.reshape(space))
    for number in range(len(points.starts) - 1):
        start, stop = points.starts[number], points.starts[number + 1]
        slots = np.empty((INPUTS + tapes.codes.shape[1], stop - start))
        slots[I1, :], slots[I2, :], slots[J, :], slots[THETA, :] = 0, 0, 0, 1
        for r in range(9):
            for q in range(start, stop):
                slots[I1, q - start] += f[r, q] * f[r, q]
                slots[I2, q - start] += cof[r, q] * cof[r, q]
                if r < 3:
                    slots[J, q - start] += f[r, q] * cof[r, q]
        for q in range(stop - start):
            if not slots[J, q] > SMALLEST_J:
                return False
        values_of(number, tapes, slots)
        for k in range(len(values)):
            place = tapes.outputs[number, k]
            if place < 0:
                values[k, start:stop] = tapes.fixed[number, k]
            else:
                values[k, start:stop] = slots[place]
    if points.laws.second_is.any():
        add_cross_product(1.0, cof.reshape(space), f.reshape(space), mixed.reshape(space))
    for r in range(9):
        for q in range(n):
            first, second, volume = values[1 + I1, q], values[1 + I2, q], values[1 + J, q]
            total = 2 * first * f[r, q] + 2 * second * mixed[r, q] + volume * cof[r, q]
            stress[r, q] = points.weights[q] * total
    return True


@compiled
def room(outputs: int, n: int) -> Fields:
    """Make room for fields at some points."""
    return Fields(
        np.empty((9, n)), np.empty((9, n), np.float32), np.empty((9, n)), np.empty((outputs, n))
    )


@compiled
def forces_of_points(points: Points, a: Doubles) -> Doubles:
    """Gradients of the energies of all points: (m,) → (m, n_points)."""
    f = deformation(points, a)
    n = f.shape[1]
    fields, forces = room(FIRST, n), np.zeros((n, len(a)))
    stress_of(points, points.first, f, fields)
    for q in range(n):
        for r in range(9):
            for k in range(len(a)):
                forces[q, k] += fields.stress[r, q] * points.slopes[r * n + q, k]
    return forces.T


@compiled
def energy_at(points: Points, a: Doubles, force: Doubles, gradient: Doubles) -> float:
    """Return Π in J and write its gradient, (m,); +∞ without it where J is not positive."""
    f = deformation(points, a)
    fields = room(FIRST, f.shape[1])
    if not stress_of(points, points.first, f, fields):
        return np.inf
    energy = product_of(points.weights, fields.values[0])
    if not energy < np.inf:  # no energy, or none that is a number
        return np.inf
    internal = fields.stress.reshape(-1) @ points.slopes
    for k in range(len(a)):
        gradient[k] = internal[k] - force[k]
        energy -= force[k] * a[k]
    return energy


@compiled
def add_crossed(factor: float, f: Doubles, q: int, out: Singles) -> None:
    """Add the matrix of x A × · at a point, of A in a column: (9, n_points) → (9, 9)."""
    for i in range(3):
        i1, i2 = 3 * ((i + 1) % 3), 3 * ((i + 2) % 3)
        for c in range(3):
            r, c1, c2 = 3 * i + c, (c + 1) % 3, (c + 2) % 3
            out[r, i1 + c1] += factor * f[i2 + c2, q]
            out[r, i2 + c2] += factor * f[i1 + c1, q]
            out[r, i1 + c2] -= factor * f[i2 + c1, q]
            out[r, i2 + c1] -= factor * f[i1 + c2, q]


@compiled
def stiffness_of(points: Points, a: Doubles, modes: Singles) -> Doubles:
    """Π'' in J for some of the modes, whose slopes are given: (9 · n_points, k) → (k, k)."""
    f, tapes = deformation(points, a), points.laws.energy
    n, turned = f.shape[1], np.zeros_like(modes)
    fields = room(tapes.outputs.shape[1], n)
    stress_of(points, tapes, f, fields)
    moduli, crossed = np.empty((9, 9), np.float32), np.empty((9, 9), np.float32)
    by = np.empty((3, 9))  # I_a'
    for q in range(n):
        values = fields.values[:, q]
        moduli[:] = 0
        if values[1 + I2] != 0:
            crossed[:] = 0
            add_crossed(1.0, f, q, crossed)
            moduli[:] = np.float32(2 * values[1 + I2]) * (crossed @ crossed)
            add_crossed(2 * values[1 + I2], fields.cof, q, moduli)
        add_crossed(values[1 + J], f, q, moduli)
        for r in range(9):
            moduli[r, r] += 2 * values[1 + I1]
            by[I1, r], by[I2, r] = 2 * f[r, q], 2 * fields.mixed[r, q]
            by[J, r] = fields.cof[r, q]
        for one in range(3):
            for other in range(3):
                factor = values[pair(one, other)]
                if factor != 0:
                    for r in range(9):
                        for t in range(9):
                            moduli[r, t] += factor * by[one, r] * by[other, t]
        for r in range(9):
            out = turned[r * n + q]
            for t in range(9):
                factor = np.float32(points.weights[q]) * moduli[r, t]
                slopes = modes[t * n + q]
                for k in range(len(out)):
                    out[k] += factor * slopes[k]
    return (modes.T @ turned).astype(np.float64)


@compiled
def inverse(matrix: Doubles, out: Doubles) -> bool:
    """Write the inverse of a symmetric matrix, (k, k), by Cholesky; False if it is not positive."""
    n = len(matrix)
    factor = np.zeros((n, n))  # L⁻¹ takes the place of L
    for i in range(n):
        for p in range(i + 1):
            total = matrix[i, p]
            for k in range(p):
                total -= factor[i, k] * factor[p, k]
            if i > p:
                factor[i, p] = total / factor[p, p]
            elif total > 0:
                factor[i, i] = math.sqrt(total)
            else:
                return False
    for i in range(n):
        for p in range(i):
            total = 0.0
            for k in range(p, i):
                total -= factor[i, k] * factor[k, p]
            factor[i, p] = total / factor[i, i]
        factor[i, i] = 1 / factor[i, i]
    out[:] = factor.T @ factor
    return True


@compiled
def compliance_near(points: Points, a: Doubles) -> Doubles:
    """First inverse of Π'' of the search, (m, m): exact among the leading modes, else at rest."""
    first, k = np.eye(len(a)), points.leading.shape[1]
    stiffness, block = stiffness_of(points, a, points.leading), np.empty((k, k))
    shift = 0.0
    while not inverse(stiffness + shift * np.eye(k), block):
        shift = max(FIRST_SHIFT, SHIFT_GROWTH * shift)
    first[:k, :k] = block
    return first


@compiled
def update(compliance: Doubles, step: Doubles, change: Doubles) -> None:
    """Change an approximate inverse of Π'' so that it takes a change of the gradient to its step.

    It stays positive definite (Broyden, Fletcher, Goldfarb and Shanno).
    """
    along = step @ change
    if not along > 0:
        return
    turned = compliance @ change
    scale = (1 + (change @ turned) / along) / along
    for i in range(len(step)):
        for k in range(len(step)):
            compliance[i, k] += (
                scale * step[i] * step[k] - (turned[i] * step[k] + step[i] * turned[k]) / along
            )


@compiled
def least_energy(
    points: Points,
    force: Doubles,
    start: Doubles,
    tolerance: float,
    evaluations: int,
) -> Doubles:
    """Return a of the least Π, (m,), or of the least one that some evaluations find.

    Parameters
    ----------
    points : Points
    force, start : array, (m,)
        g in J, and the first a; the undeformed body takes its place if J is not positive there.
    tolerance : float
        Length of the last step, relative to a.
    evaluations : int
        Of Π, at most.
    """
    a, gradient, other = start.copy(), np.empty(len(start)), np.empty(len(start))
    energy, done = energy_at(points, a, force, gradient), 1
    if energy == np.inf:
        a[:] = 0
        energy = energy_at(points, a, force, gradient)
    near, steps = compliance_near(points, a), 0
    while done < evaluations:
        steps += 1
        if steps % RENEWED == 0:
            near = compliance_near(points, a)
        step = -(near @ gradient)
        slope, length = float(gradient @ step), 1.0
        is_last = step @ step <= tolerance**2 * (a @ a)
        small = ROUNDING * (abs(energy) + abs(float(force @ a)))
        while True:
            trial = a + length * step
            found = energy_at(points, trial, force, other)
            done += 1
            if found <= energy + SUFFICIENT * length * slope + small:
                break
            over = found - energy - slope * length
            best = -slope * length / (2 * over) if over < np.inf else HALF
            length *= min(max(best, LEAST_CUT), HALF)
            if length < SHORTEST or done >= evaluations:
                return a
        if is_last and length == 1.0:
            return trial
        update(near, trial - a, other - gradient)
        a, energy = trial, found
        gradient, other = other, gradient
    return a


def points_of(
    slopes: NDArray[Any], weights: Doubles, laws: Sequence[Law], starts: NDArray[np.int64], k: int
) -> Points:
    """Make points of gradients (n_points, d, d, m), law after law, with k leading modes."""
    n, d, _, modes = slopes.shape
    of_space = np.zeros((3, 3, n, modes), np.float32)
    of_space[:d, :d] = slopes.transpose(1, 2, 0, 3)
    single = of_space.reshape(9 * n, modes)
    every = Laws.of(laws)
    counts = np.maximum(every.energy.outputs[:, :FIRST].max(axis=1) + 1 - INPUTS, 0)
    first = every.energy._replace(counts=counts)
    return Points(single, np.ascontiguousarray(single[:, :k]), weights, every, first, starts)
