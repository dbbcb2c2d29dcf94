r"""Energy in modes, its derivatives and its minimum, in loops that Numba compiles.

At every point :math:`e = J - 1` and, with the factors μ, g and d of
`surrogate.series.stress_series.Factors`,

.. math::
    W = \tfrac{μ}{2} (F:F - 3) - μ e + \tfrac{g}{2} e^2 + d (e - \ln(1 + e)), \qquad
    P = μ F + s \, \mathrm{cof} F, \qquad s = g J + d - g - μ - d / J,

.. math::
    \frac{∂P}{∂F} : H = μ H + s \, F × H + (g + d / J^2) (\mathrm{cof} F : H) \, \mathrm{cof} F.

In the plane :math:`F_{33} = 1`.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from surrogate.mechanics.compiled.fields import compiled

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
    slopes : array, (9 · n_points, m)
        Gradients of the modes in 1/m times the unit of a, row 3 i + j of every point.
    leading : array, (9 · n_points, k)
        Those of the first k modes.
    mu, growth, decay : array, (n_points,)
        μ, g and d times the weight of the point, in J.
    """

    slopes: Singles
    leading: Singles
    mu: Doubles
    growth: Doubles
    decay: Doubles


@compiled
def deformation(points: Points, a: Doubles) -> Doubles:
    """F at the points: (m,) → (9, n_points)."""
    f = (points.slopes @ a.astype(np.float32)).astype(np.float64)
    f = f.reshape(9, len(points.mu))
    for i in range(3):
        for q in range(f.shape[1]):
            f[4 * i, q] += 1
    return f


@compiled
def cofactors(f: Doubles, q: int, out: Doubles) -> float:
    """Write cof F of a point, and return J."""
    for i in range(3):
        i1, i2 = 3 * ((i + 1) % 3), 3 * ((i + 2) % 3)
        for j in range(3):
            j1, j2 = (j + 1) % 3, (j + 2) % 3
            out[3 * i + j] = f[i1 + j1, q] * f[i2 + j2, q] - f[i1 + j2, q] * f[i2 + j1, q]
    return f[0, q] * out[0] + f[1, q] * out[1] + f[2, q] * out[2]


@compiled
def forces_of_points(points: Points, a: Doubles) -> Doubles:
    """Gradients of the energies of all points: (m,) → (m, n_points)."""
    f, cofactor = deformation(points, a), np.empty(9)
    n = f.shape[1]
    forces = np.zeros((n, len(a)))
    for q in range(n):
        j = cofactors(f, q, cofactor)
        mu, growth, decay = points.mu[q], points.growth[q], points.decay[q]
        s = growth * (j - 1) - mu + decay * (j - 1) / j
        for r in range(9):
            stress = mu * f[r, q] + s * cofactor[r]
            for k in range(len(a)):
                forces[q, k] += stress * points.slopes[r * n + q, k]
    return forces.T


@compiled
def energy_at(points: Points, a: Doubles, force: Doubles, gradient: Doubles) -> float:
    """Return Π in J and write its gradient, (m,); +∞ without it where J is not positive."""
    f = deformation(points, a)
    stress, cofactor = np.empty(f.shape, np.float32), np.empty(9)
    energy = 0.0
    for q in range(f.shape[1]):
        j = cofactors(f, q, cofactor)
        if not j > SMALLEST_J:
            return np.inf
        e, mu, growth, decay = j - 1, points.mu[q], points.growth[q], points.decay[q]
        square = 0.0
        for r in range(9):
            square += f[r, q] ** 2
        energy += mu * ((square - 3) / 2 - e) + growth * e * e / 2 + decay * (e - math.log1p(e))
        s = growth * e - mu + decay * e / j
        for r in range(9):
            stress[r, q] = mu * f[r, q] + s * cofactor[r]
    internal = stress.reshape(-1) @ points.slopes
    for k in range(len(a)):
        gradient[k] = internal[k] - force[k]
        energy -= force[k] * a[k]
    return energy


@compiled
def stiffness_of(points: Points, a: Doubles, modes: Singles) -> Doubles:
    """Π'' in J for some of the modes, whose slopes are given: (9 · n_points, k) → (k, k)."""
    f = deformation(points, a)
    n, cofactor, turned = f.shape[1], np.empty(9), np.zeros_like(modes)
    moduli = np.empty((9, 9), np.float32)
    for q in range(n):
        j = cofactors(f, q, cofactor)
        mu, growth, decay = points.mu[q], points.growth[q], points.decay[q]
        s = growth * (j - 1) - mu + decay * (j - 1) / j
        second = growth + decay / j**2
        for r in range(9):
            for t in range(9):
                moduli[r, t] = second * cofactor[r] * cofactor[t]
            moduli[r, r] += mu
            i, c = r // 3, r % 3
            i1, i2, c1, c2 = 3 * ((i + 1) % 3), 3 * ((i + 2) % 3), (c + 1) % 3, (c + 2) % 3
            moduli[r, i1 + c1] += s * f[i2 + c2, q]
            moduli[r, i2 + c2] += s * f[i1 + c1, q]
            moduli[r, i1 + c2] -= s * f[i2 + c1, q]
            moduli[r, i2 + c1] -= s * f[i1 + c2, q]
        for r in range(9):
            out = turned[r * n + q]
            for t in range(9):
                factor, slopes = moduli[r, t], modes[t * n + q]
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


def points_of(slopes: NDArray[Any], factors: Doubles, leading: int) -> Points:
    """Make points of gradients (n_points, d, d, m) and factors (3, n_points) times weights."""
    n, d, _, modes = slopes.shape
    of_space = np.zeros((3, 3, n, modes), np.float32)
    of_space[:d, :d] = slopes.transpose(1, 2, 0, 3)
    single = of_space.reshape(9 * n, modes)
    return Points(single, np.ascontiguousarray(single[:, :leading]), *factors)
