r"""The softest modes of a body, in which it buckles: how stiff they are at a deformed state.

.. math::
    θ = \min_y \frac{s · K(u) \, s}{s · P^{-1} s}, \qquad s = T \sum_i y_i φ_i, \qquad
    s · P^{-1} s = \sum_i y_i^2

with the modes φ of the undeformed body, of unit φ · K(0) φ, carried to the state
(`surrogate.mechanics.descent.carried_compliance`). It is the least Ritz value of P K(u) in their
span, which is never below the least eigenvalue; all eigenvalues are 1 where P is exact. A small θ
says that a direction made with P is too short along s, a negative one that the state is not stable.
Combinations matter: the edge of a plate buckles by bending and torsion at once.

Products with K(u) cost a residual each. The stresses are looked at first. They are what softens a
mode,

.. math:: θ ≈ 1 + \min_{|y| = 1} \sum_{ij} y_i \, y_j \sum_q w_q \, S_q : (H_i^T H_j)_q, \qquad
          H_i = F \, ∇φ_i

with the second Piola–Kirchhoff stress S, by the means of F and P over the cells.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from surrogate.mechanics.compiled.cells import Cells
from surrogate.mechanics.compiled.fields import Array as Values
from surrogate.mechanics.compiled.fields import (
    add_contraction,
    cofactors,
    compiled,
    rough_product,
)
from surrogate.mechanics.compiled.loops import mean
from surrogate.mechanics.compiled.solid import CompiledSolid
from surrogate.mechanics.equilibrium.out_of_balance import Equilibrium

Array = NDArray[np.float64]
MODES, BESIDE = 6, 4  # that are kept, and others that are iterated with them
ITERATIONS = 8


def soft_modes(equilibrium: Equilibrium, respond: Callable[[Array], Array]) -> Array:
    """The softest modes of the undeformed body, of unit φ · K(0) φ: (n_modes, n_points, d).

    Parameters
    ----------
    equilibrium : Equilibrium
    respond : callable
        Forces (N, n_points, d) in N to linear responses in m.
    """
    shape = equilibrium.free.shape
    count = min(MODES + BESIDE, len(equilibrium.layout.dofs))
    x = np.random.default_rng(0).normal(size=(count, *shape)) * equilibrium.free
    for _ in range(ITERATIONS):  # subspace iteration
        rows = respond(x).reshape(count, -1)
        x = np.linalg.qr(rows.T)[0].T.reshape(x.shape)
    response = respond(x).reshape(count, -1)
    softness, turn = np.linalg.eigh(response @ x.reshape(count, -1).T)
    order = np.argsort(-softness)[:MODES]
    modes = turn.T[order] @ response / np.sqrt(softness[order])[:, None]
    return np.asarray(modes.reshape(-1, *shape))


class Softening:
    """What the stresses of a state do to the softest modes.

    Parameters
    ----------
    solid : CompiledSolid
        At whose points stresses and deformation gradients are given, in its rows.
    modes : array, (n_modes, n_points, d)
        Of unit φ · K(0) φ.
    """

    def __init__(self, solid: CompiledSolid, modes: Array) -> None:
        self._cells, blocks = solid.cells, len(solid.cells.numbers)
        shape = len(modes), blocks, *solid.cells.gradients.shape[3:4] * 2, solid.cells.row
        self._slopes = np.empty(shape, np.float32)
        for mode, of_mode in zip(modes, self._slopes, strict=True):
            slopes = solid.slopes(mode)
            for block in range(blocks):
                mean(solid.cells, block, slopes, of_mode[block])

    def least(self, f: Array, piola: Array) -> float:
        """θ by the stresses alone, of F and P in Pa: rows; −∞ where a cell is inverted."""
        work = np.zeros((len(self._slopes),) * 2)
        inside = add_work_of_stresses(self._cells, f, piola, self._slopes, work)
        return 1 + least_eigenvalue(work) if inside else -np.inf


@compiled
def add_work_of_stresses(cells: Cells, f: Array, piola: Array, slopes: Values, out: Array) -> bool:
    """Add V S : (Hᵢᵀ Hⱼ) with H = F ∇φ to one half; False where a cell is inverted in the mean.

    Parameters
    ----------
    cells : Cells
    f, piola : array, (n_rows, d, d, n)
    slopes : array, (n_modes, n_blocks, d, d, n)
        ∇φ, in whose precision sums are.
    out : array, (n_modes, n_modes)
        The upper half is left.
    """
    modes, blocks, d, _, row = slopes.shape
    h, stressed = np.empty((modes, d, d, row), slopes.dtype), np.empty(row, slopes.dtype)
    tensors, j = np.empty((4, d, d, row), slopes.dtype), np.empty(row, slopes.dtype)
    of, stress, cof, weighted = tensors[0], tensors[1], tensors[2], tensors[3]
    points = cells.gradients.shape[1]
    for block in range(blocks):
        mean(cells, block, f, of)
        mean(cells, block, piola, stress)
        cofactors(of, cof)
        j[:] = 0
        add_contraction(1 / d, of, cof, j)
        for q in range(row):
            if cells.numbers[block, q] < 0:
                j[q] = 1
            elif not j[q] > 0:
                return False
            volume = 0.0
            for p in range(points):
                volume += cells.volumes[block * points + p, q]
            j[q] = volume / j[q]
        weighted[:] = 0
        for i in range(d):  # V S = V cof Fᵀ P / J
            for k in range(d):
                total = weighted[i, k]
                for n in range(d):
                    a, b = cof[n, i], stress[n, k]
                    for q in range(row):
                        total[q] += j[q] * a[q] * b[q]
        h[:] = 0
        for m in range(modes):
            for i in range(d):
                for k in range(d):
                    total = h[m, i, k]
                    for n in range(d):
                        a, b = of[i, n], slopes[m, block, n, k]
                        for q in range(row):
                            total[q] += a[q] * b[q]
        for m in range(modes):
            for i in range(d):
                for k in range(d):
                    stressed[:] = 0
                    for n in range(d):
                        a, b = h[m, i, n], weighted[n, k]
                        for q in range(row):
                            stressed[q] += a[q] * b[q]
                    for n in range(m + 1):
                        out[m, n] += rough_product(stressed, h[n, i, k])
    return True


def least_eigenvalue(matrix: Array) -> float:
    """Least eigenvalue of a symmetric matrix by its lower half."""
    return float(np.linalg.eigvalsh(matrix)[0])
