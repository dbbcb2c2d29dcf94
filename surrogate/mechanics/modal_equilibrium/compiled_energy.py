"""Energy in modes, its derivatives and its minimum, in loops that Numba compiles.

Stresses and moduli are those of the programs of the laws (`surrogate.mechanics.compiled.run`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from surrogate.mechanics.compiled.fields import compiled, product_of
from surrogate.mechanics.compiled.program import Programs
from surrogate.mechanics.compiled.run import begin, run
from surrogate.mechanics.energy.law import Law
from surrogate.mechanics.solids.deformation import recorded_law

SMALLEST_J = 1e-3
SUFFICIENT = 1e-4  # decrease of a step, over that of its slope (Armijo)
SHORTEST = 1e-2  # of a step, relative
ROUNDING = 1e-9  # of Π, relative to the stored energy
LEAST_CUT, HALF = 0.1, 0.5  # of a step that is shortened
RENEWED = 10  # steps after which the first inverse is computed again
FIRST_SHIFT, SHIFT_GROWTH = 0.1, 4.0  # relative to the stiffness at rest
Doubles = NDArray[np.float64]
Singles = NDArray[np.float32]


class Points(NamedTuple):
    """Points of a cubature, with the modes of a body there.

    Attributes
    ----------
    slopes : array, (d² · n_points, m)
        Gradients of the modes in 1/m times the unit of a, row d i + j of every point.
    leading : array, (d² · n_points, k)
        Those of the first k modes.
    weights : array, (n_points,)
        In m³.
    programs : Programs
        Of stress, J and energy.
    starts : array of int, (n_laws + 1,)
        First point of every law, then the number of points.
    """

    slopes: Singles
    leading: Singles
    weights: Doubles
    programs: Programs
    starts: NDArray[np.int64]


@compiled
def stress_of(points: Points, a: Doubles, stress: Singles, moduli: Singles) -> float:
    """Write P times the weights of the points, and its derivatives; return the energy in J.

    It is +∞, without them, where J is not positive or there is no energy.

    Parameters
    ----------
    points : Points
    a : array, (m,)
    stress : array, (d², n_points)
    moduli : array, (d², d², n_points), or no rows
        Derivatives by every component of F.
    """
    slopes = (points.slopes @ a.astype(np.float32)).reshape(-1, len(points.weights))
    square, programs, energy = len(slopes), points.programs, 0.0
    d = 2 if square == 4 else 3
    for law in range(len(points.starts) - 1):
        start, stop = points.starts[law], points.starts[law + 1]
        values = np.empty((2, programs.slots, stop - start))
        known = np.empty((2, programs.slots), np.bool_)
        outputs, weights = programs.outputs[law], points.weights[start:stop]
        begin(values, known)
        for i in range(square):
            known[0, 1 + i], unit = True, 1 if i % (d + 1) == 0 else 0
            for q in range(start, stop):
                values[0, 1 + i, q - start] = unit + slopes[i, q]
        run(programs, law, 0, values, known)
        for j in values[0, outputs[square]]:
            if not j > SMALLEST_J:
                return np.inf
        energy += product_of(weights, values[0, outputs[square + 1]])
        for i in range(square):
            for q in range(start, stop):
                stress[i, q] = weights[q - start] * values[0, outputs[i], q - start]
        for k in range(len(moduli)):
            known[1, 1 + k], values[1, 1 + k] = True, 1
            run(programs, law, 1, values, known)
            known[1, 1 + k] = False
            for i in range(square):
                for q in range(start, stop):
                    change = values[1, outputs[i], q - start] if known[1, outputs[i]] else 0.0
                    moduli[k, i, q] = weights[q - start] * change
    return energy if energy < np.inf else np.inf  # no energy, or none that is a number


@compiled
def forces_of_points(points: Points, a: Doubles) -> Doubles:
    """Gradients of the energies of all points: (m,) → (m, n_points)."""
    n, square = len(points.weights), len(points.slopes) // len(points.weights)
    stress, forces = np.empty((square, n), np.float32), np.zeros((n, len(a)))
    stress_of(points, a, stress, np.empty((0, square, n), np.float32))
    for q in range(n):
        for r in range(square):
            for k in range(len(a)):
                forces[q, k] += stress[r, q] * points.slopes[r * n + q, k]
    return forces.T


@compiled
def energy_at(points: Points, a: Doubles, force: Doubles, gradient: Doubles) -> float:
    """Return Π in J and write its gradient, (m,); +∞ without it where J is not positive."""
    n, square = len(points.weights), len(points.slopes) // len(points.weights)
    stress = np.empty((square, n), np.float32)
    energy = stress_of(points, a, stress, np.empty((0, square, n), np.float32))
    if energy == np.inf:
        return energy
    internal = stress.reshape(-1) @ points.slopes
    for k in range(len(a)):
        gradient[k] = internal[k] - force[k]
        energy -= force[k] * a[k]
    return energy


@compiled
def stiffness_of(points: Points, a: Doubles, modes: Singles) -> Doubles:
    """Π'' in J for some of the modes, whose slopes are given: (d² · n_points, k) → (k, k)."""
    n, square = len(points.weights), len(points.slopes) // len(points.weights)
    stress, moduli = np.empty((square, n), np.float32), np.empty((square, square, n), np.float32)
    stress_of(points, a, stress, moduli)
    turned = np.zeros_like(modes)
    for r in range(square):
        for t in range(square):
            for q in range(n):
                out, slopes, factor = turned[r * n + q], modes[t * n + q], moduli[t, r, q]
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
    of_rows = slopes.transpose(1, 2, 0, 3).reshape(d * d * n, modes).astype(np.float32)
    recorded = [recorded_law(law, d, False) for law in laws]
    programs = Programs.of(recorded, 0, ["stress", "volume", "energy"])
    return Points(of_rows, np.ascontiguousarray(of_rows[:, :k]), weights, programs, starts)
