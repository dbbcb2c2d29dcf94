r"""The softest modes of a body, in which it buckles: how stiff they are at a deformed state.

.. math::
    θ = \min_y \frac{s · K(u) \, s}{s · P^{-1} s}, \qquad s = T \sum_i y_i φ_i, \qquad
    s · P^{-1} s = \sum_i y_i^2

with the modes φ of the undeformed body, of unit φ · K(0) φ, carried to the state
(`surrogate.descent.carried_compliance`). It is the least Ritz value of P K(u) in their span, which
is never below the least eigenvalue; all eigenvalues are 1 where P is exact. A small θ says that a
direction made with P is too short along s, a negative one that the state is not stable.
Combinations matter: the edge of a plate buckles by bending and torsion at once.

Products with K(u) cost a residual each. Where forces are a sum over points, the stresses are looked
at instead. They are what softens a mode,

.. math:: θ ≈ 1 + \min_{|y| = 1} \sum_{ij} y_i \, y_j \sum_q w_q \, S_q : (H_i^T H_j)_q, \qquad
          H_i = F \, ∇φ_i

with the second Piola–Kirchhoff stress S and the means of F over the cells.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from surrogate.descent.cell_fields import CellFields, Values, jacobian, product
from surrogate.mechanics.out_of_balance import Equilibrium
from surrogate.series.compiled_fields import compiled

Array = NDArray[np.float64]
MODES, BESIDE = 6, 4  # that are kept, and others that are iterated with them
ITERATIONS = 8
BLOCK = 128  # points


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
    fields : CellFields
        At whose points stresses and deformation gradients are given.
    modes : array, (n_modes, n_points, d)
        Of unit φ · K(0) φ.
    """

    def __init__(self, fields: CellFields, modes: Array) -> None:
        self.fields = fields
        self._slopes = np.array([fields.slopes(mode) for mode in modes])

    def least(self, f: Values, piola: Values) -> float:
        """θ by the stresses alone, of F and P in Pa: (d, d, n) each."""
        j, cofactors = jacobian(f)
        weighted = product(cofactors.swapaxes(0, 1), piola) * (self.fields.weights / j)  # w S
        return 1 + least_eigenvalue(work_of_stresses(f, weighted, self._slopes))


@compiled
def work_of_stresses(f: Values, stress: Values, slopes: Values) -> Values:
    """Σ_q S : (Hᵢᵀ Hⱼ) with H = F ∇φ: (n_modes, n_modes), by blocks that stay in the cache.

    Parameters
    ----------
    f, stress : array, (d, d, n)
        F, and S times the volumes of the points.
    slopes : array, (n_modes, d, d, n)
        ∇φ.
    """
    modes, d, _, points = slopes.shape
    h, stressed = np.empty((modes, d, d, BLOCK), f.dtype), np.empty(BLOCK, f.dtype)
    out = np.zeros((modes, modes), f.dtype)
    for start in range(0, points, BLOCK):
        end = min(start + BLOCK, points)
        for m in range(modes):
            for i in range(d):
                for j in range(d):
                    row = h[m, i, j]
                    row[:] = 0
                    for k in range(d):
                        a, b = f[i, k, start:end], slopes[m, k, j, start:end]
                        for q in range(end - start):
                            row[q] += a[q] * b[q]
        for m in range(modes):
            for i in range(d):
                for j in range(d):
                    stressed[:] = 0
                    for k in range(d):
                        a, b = h[m, i, k], stress[k, j, start:end]
                        for q in range(end - start):
                            stressed[q] += a[q] * b[q]
                    for n in range(m + 1):
                        row, total = h[n, i, j], f.dtype.type(0)
                        for q in range(end - start):
                            total += stressed[q] * row[q]
                        out[m, n] += total
    for m in range(modes):
        out[:m, m] = out[m, :m]
    return out


def least_eigenvalue(matrix: Array) -> float:
    """Least eigenvalue of the symmetric part of a matrix."""
    return float(np.linalg.eigvalsh((matrix + matrix.T) / 2)[0])
