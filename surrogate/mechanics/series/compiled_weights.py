r"""The combination of the terms of a series that has the least potential energy, compiled.

.. math::
    u = \sum_{k=1}^n c_k u_k, \qquad Π(c) = E(u) - f · u \to \min, \qquad
    \frac{∂Π}{∂c_k} = \sum_q w_q P_q : H_{k,q} - a_k, \quad a_k = f · u_k

with :math:`F = I + \sum_k c_k H_k`. All sums are in double precision, whatever that of the terms
is. The works aₖ are those of the stress that is linear in H₁, since f = K u₁.

Newton's method minimises Π, from terms that fade where they do not decrease, under half of the load
as long as Π is infinite there. The Hessian is kept as long as steps with it become much shorter. A
step that raises Π is not taken; the next one is tried with a larger shift of the Hessian
(Levenberg, Marquardt).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surrogate.mechanics.compiled.cells import Cells
from surrogate.mechanics.compiled.fields import (
    Array,
    add_multiple,
    inner,
    product_of,
    rough_product,
)
from surrogate.mechanics.compiled.program import Numbers, Programs
from surrogate.mechanics.compiled.run import Flags, begin, run
from surrogate.mechanics.series.compiled_terms import undeformed

Doubles = NDArray[np.float64]
EVALUATIONS = 30  # of Π, at most
SMALLEST_SHIFT, SECOND_SHIFT, GROWTH = 1e-9, 1e-3, 10.0  # relative to the stiffness of every term
LEFT = 1e-3  # of a small step, as it would follow one with a Hessian that is kept
SHORTER = 0.2  # of the step before, one with the same Hessian, at most
ROUNDING, LEAST = 2.0**-40, 2.0**-50  # of Π, relative, and to the shear moduli times volumes
SMALL_STEP, SMALLEST_STEP = 3e-4, 1e-10  # relative to the last term, and to the first one
TINY = 1e-60  # no division by zero; energies are those of volumes of about 1


class Potential(NamedTuple):
    """What Π(c) is made of.

    Attributes
    ----------
    kept : array, (n_rows, n, n_kept, n_points)
        Hₖ first, in rows of points.
    cells : Cells
    programs : Programs
        Of stress, J and energy.
    fibres : array, (n_blocks, n_components, n_points)
    at_rest : array, (2, n_laws)
        Shear moduli and energy densities.
    squares : array, (n,)
        Σ w μ Hₖ : Hₖ.
    works : array, (n,)
        a.
    """

    kept: Array
    cells: Cells
    programs: Programs
    fibres: Array
    at_rest: Doubles
    squares: Doubles
    works: Doubles


@inner
def potential_of_terms(
    kept: Array, cells: Cells, programs: Programs, fibres: Array, moduli: Doubles
) -> Potential:
    """Make Π of terms, with the moduli and energy densities at rest."""
    squares, works = np.zeros(kept.shape[1]), np.zeros(kept.shape[1])
    n, points, d = kept.shape[1], kept.shape[3], cells.gradients.shape[3]
    values, known = np.empty((2, programs.slots, points)), np.empty((2, programs.slots), np.bool_)
    last = -1
    for row in range(len(kept)):
        block, volumes = row // cells.gradients.shape[1], cells.volumes[row]
        law = cells.laws[block]
        if law != last or len(fibres[block]):
            undeformed(programs, law, d, fibres[block], values, known)
        last = law
        for i in range(d * d):
            values[1, 1 + i] = kept[row, 0, i]
            known[1, 1 + i] = True
        run(programs, law, 1, values, known)
        for i in range(d * d):
            stress = values[1, programs.outputs[law, i]]
            for k in range(n):
                h = kept[row, k, i]
                square, work = 0.0, 0.0
                for q in range(points):
                    square += volumes[q] * h[q] * h[q]
                    work += volumes[q] * stress[q] * h[q]
                squares[k] += moduli[0, law] * square
                works[k] += work
    return Potential(kept, cells, programs, fibres, moduli, squares, works)


@inner
def _set_state(c: Doubles, potential: Potential, row: int, values: Array, known: Flags) -> None:
    """Write the slots of order 0 at a row of points, with F = I + Σ cₖ Hₖ."""
    kept, cells, programs, fibres, _, _, _ = potential
    d, block = cells.gradients.shape[3], row // cells.gradients.shape[1]
    begin(values, known)
    known[0, 1 : programs.inputs] = True
    for i in range(d * d):
        f = values[0, 1 + i]
        f[:] = 1 if i % (d + 1) == 0 else 0
        for k in range(len(c)):
            add_multiple(c[k], kept[row, k, i], f)
    for i in range(len(fibres[block])):
        values[0, 1 + d * d + i] = fibres[block, i]
    run(programs, cells.laws[block], 0, values, known)


@inner
def _weighted(volumes: Array, values: Array, outputs: Numbers, out: Array) -> None:
    """Write the stress times the volumes of the points: (d², n)."""
    for i in range(len(out)):
        total, p = out[i], values[outputs[i]]
        for q in range(len(volumes)):
            total[q] = volumes[q] * p[q]


@inner
def energy_at(c: Doubles, potential: Potential, gradient: Doubles) -> float:
    """Return Π, and write its derivatives; +∞ without them where J is not positive at a point.

    Parameters
    ----------
    c : array, (n,)
    potential : Potential
    gradient : array, (n,)
        Output.
    """
    kept, cells, programs, _, at_rest, _, works = potential
    points, square = kept.shape[3], cells.gradients.shape[3] ** 2
    values, known = np.empty((1, programs.slots, points)), np.empty((1, programs.slots), np.bool_)
    stress, energy = np.empty((square, points)), 0.0
    for k in range(len(c)):
        gradient[k] = -works[k]
        energy -= c[k] * works[k]
    for row in range(len(kept)):
        law, volumes = cells.laws[row // cells.gradients.shape[1]], cells.volumes[row]
        _set_state(c, potential, row, values, known)
        outputs, rest, least = programs.outputs[law], at_rest[1, law], 1.0
        j, density = values[0, outputs[square]], values[0, outputs[square + 1]]
        for q in range(points):
            least = min(least, j[q])
            energy += volumes[q] * (density[q] - rest)
        if not (least > 0 and energy < np.inf):  # no energy, or none that is a number
            return np.inf
        _weighted(volumes, values[0], outputs, stress)
        for k in range(len(c)):
            gradient[k] += product_of(stress.ravel(), kept[row, k, :square].ravel())
    return energy


@inner
def set_hessian(c: Doubles, potential: Potential, hessian: Doubles) -> None:
    """Write the lower half of the second derivatives of Π, in the precision of the fields."""
    kept, cells, programs, _, _, _, _ = potential
    points, square = kept.shape[3], cells.gradients.shape[3] ** 2
    values = np.empty((2, programs.slots, points), kept.dtype)
    known, stress = np.empty((2, programs.slots), np.bool_), np.empty((square, points), kept.dtype)
    hessian[:] = 0
    for row in range(len(kept)):
        law, volumes = cells.laws[row // cells.gradients.shape[1]], cells.volumes[row]
        _set_state(c, potential, row, values, known)
        known[1, 1 : 1 + square] = True
        for k in range(len(c)):
            values[1, 1 : 1 + square] = kept[row, k, :square]
            run(programs, law, 1, values, known)
            _weighted(volumes, values[1], programs.outputs[law], stress)
            for i in range(k + 1):
                hessian[k, i] += rough_product(stress.ravel(), kept[row, i, :square].ravel())


@inner
def newton_step(
    gradient: Doubles, hessian: Doubles, scale: Doubles, shift: float, step: Doubles
) -> float:
    """Write the step of Newton's method in units of `scale`, by the lower half of the Hessian.

    Return its length.
    """
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
    return product_of(step, step) ** 0.5


@inner
def least_energy(potential: Potential, rounding: float) -> Doubles:
    """Return the coefficients of the least Π, (n,).

    Parameters
    ----------
    potential : Potential
    rounding : float
        Relative rounding of a number in the precision of the fields.
    """
    n = potential.kept.shape[1]
    squares, scale, c, stiffness = potential.squares, np.empty(n), np.ones(n), 0.0
    points = potential.cells.gradients.shape[1]
    for row in range(len(potential.kept)):
        modulus = potential.at_rest[0, potential.cells.laws[row // points]]
        for volume in potential.cells.volumes[row]:
            stiffness += modulus * volume
    for k in range(n):
        scale[k] = (squares[k] + rounding**2 * squares[0] + TINY) ** -0.5
        if k > 0:
            c[k] = c[k - 1] / (1 + (squares[k] / (squares[k - 1] + TINY)) ** 2)
    gradient, hessian, step, trial = np.empty(n), np.empty((n, n)), np.empty(n), np.empty(n)
    new_gradient = np.empty(n)
    energy, shift = energy_at(c, potential, gradient), SMALLEST_SHIFT
    before, is_new = 0.0, False  # length of the last step, and whether the Hessian is that at c
    for _ in range(EVALUATIONS):
        if energy == np.inf:
            for k in range(n):
                c[k] *= 0.5 ** (k + 1)
            energy = energy_at(c, potential, gradient)
            continue
        size = newton_step(gradient, hessian, scale, shift, step) if is_new or before > 0 else 0.0
        if not is_new and not size < SHORTER * before:
            set_hessian(c, potential, hessian)
            size, is_new = newton_step(gradient, hessian, scale, shift, step), True
        for k in range(n):
            trial[k] = c[k] - scale[k] * step[k]
        small = SMALL_STEP * abs(c[n - 1] / scale[n - 1]) + max(SMALLEST_STEP, rounding) / scale[0]
        if not is_new:
            small = min(small, (LEFT * small * before) ** 0.5)
        if shift == SMALLEST_SHIFT and size <= small:
            return trial  # the next step is of the order of the square
        new_energy = energy_at(trial, potential, new_gradient)
        if new_energy <= energy + ROUNDING * abs(energy) + LEAST * stiffness:
            energy, before = new_energy, size if shift == SMALLEST_SHIFT else 0.0
            c, trial, shift, is_new = trial, c, SMALLEST_SHIFT, False
            gradient, new_gradient = new_gradient, gradient
        elif is_new:
            shift = max(GROWTH * shift, SECOND_SHIFT)
        else:
            before = 0.0
    return c
