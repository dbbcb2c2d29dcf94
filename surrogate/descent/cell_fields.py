"""Fields of one load at the quadrature points of a body, in compiled loops.

Displacements and forces are (n_points, d), at all points of the elements; tensors at the quadrature
points are (d, d, n), those of a cell one after the other.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import DTypeLike, NDArray

from surrogate.mechanics.out_of_balance import Equilibrium
from surrogate.series.compiled_fields import (
    add_contraction,
    add_cross_product,
    add_linear_cofactors,
    compiled,
)

Values = NDArray[Any]  # in single or double precision
Loop: TypeAlias = Callable[..., Values]


class CellFields:
    """Gradients of displacements, and forces of stresses.

    Parameters
    ----------
    equilibrium : Equilibrium
    weights : array, (n_cells, n_points of a cell), optional
        Of the stresses; by default the volumes of the points.
    dtype : data type
        Precision of all fields.
    means : bool
        Whether a cell has one point, where gradients are their means over the cell.
    """

    def __init__(
        self,
        equilibrium: Equilibrium,
        weights: NDArray[np.float64] | None = None,
        dtype: DTypeLike = np.float64,
        means: bool = False,
    ) -> None:
        solid = equilibrium.solid
        gradients = solid.gradients.numpy()
        volumes = solid.volumes.numpy() if weights is None else weights
        if means:
            whole = volumes.sum(axis=1, keepdims=True)
            gradients = np.einsum("cq,cqaj->caj", volumes / whole, gradients)[:, None]
            volumes = whole
        self.dtype, self.points = np.dtype(dtype), len(equilibrium.free)
        self.cells = equilibrium.geometry.cells
        count, points, corners, d = gradients.shape
        rows = gradients.transpose(0, 2, 3, 1).reshape(count, corners, d * points)
        self._gradients: Values = np.ascontiguousarray(rows, dtype)
        self.weights: Values = volumes.ravel().astype(dtype)
        self._slopes, self._forces = cell_loops(corners, d, points)

    def slopes(self, u: Values) -> Values:
        """∂u_i/∂x_j: (n_points, d) → (d, d, n)."""
        return self._slopes(self.cells, self._gradients, u.astype(self.dtype))

    def deformation_gradient(self, u: Values) -> Values:
        """F = I + ∇u: (n_points, d) → (d, d, n)."""
        f = self.slopes(u)
        for i in range(len(f)):
            f[i, i] += 1
        return f

    def forces(self, stress: Values) -> Values:
        """Σ_q w_q P_q ∇N_a: (d, d, n) → (n_points, d)."""
        return self._forces(self.cells, self._gradients, self.weights, stress, self.points)


def jacobian(f: Values) -> tuple[Values, Values]:
    """J = F : cof F / d and cof F: (d, d, n) → (n,), (d, d, n)."""
    cofactors, j = np.zeros_like(f), np.zeros(f.shape[2], f.dtype)
    if len(f) == 2:
        add_linear_cofactors(f, cofactors)
    else:
        add_cross_product(0.5, f, f, cofactors)
    add_contraction(1 / len(f), f, cofactors, j)
    return j, cofactors


@compiled
def product(a: Values, b: Values) -> Values:
    """Products of matrices, A B: (d, d, n) twice → (d, d, n)."""
    d, _, points = b.shape
    out = np.zeros_like(b)
    for i in range(d):
        for k in range(d):
            for j in range(d):
                for q in range(points):
                    out[i, j, q] += a[i, k, q] * b[k, j, q]
    return out


@cache
def cell_loops(corners: int, d: int, points: int) -> tuple[Loop, Loop]:
    """`slopes` and `forces` of cells with so many corners and points in d dimensions.

    Loops over a cell with one point are short: they take a third of the time or less if the
    compiler knows their lengths. Those over several points do not gain.
    """
    one = points == 1

    @compiled
    def slopes(cells: NDArray[np.int64], gradients: Values, u: Values) -> Values:
        """Gradients at the quadrature points: (n_nodes, d) → (d, d, n_cells · n_points).

        Parameters
        ----------
        cells : array of int, (n_cells, n_corners)
        gradients : array, (n_cells, n_corners, d · n_points)
            Of the shape functions.
        u : array, (n_nodes, d)
        """
        count = len(cells)
        a_cell, m, n = (corners, d, 1) if one else (cells.shape[1], u.shape[1], points)
        out, found = np.zeros((m, m, count * n), u.dtype), np.empty((m, m * n), u.dtype)
        for c in range(count):
            found[:] = 0
            for a in range(a_cell):
                for i in range(m):
                    x = u[cells[c, a], i]
                    for k in range(m * n):
                        found[i, k] += x * gradients[c, a, k]
            for i in range(m):
                for j in range(m):
                    for q in range(n):
                        out[i, j, c * n + q] = found[i, j * n + q]
        return out

    @compiled
    def forces(
        cells: NDArray[np.int64], gradients: Values, volumes: Values, stress: Values, nodes: int
    ) -> Values:
        """Forces of stresses: (d, d, n_cells · n_points) → (n_nodes, d).

        Parameters
        ----------
        cells, gradients : array
            As of `slopes`.
        volumes : array, (n_cells · n_points,)
        stress : array, (d, d, n_cells · n_points)
        nodes : int
        """
        count = len(cells)
        a_cell, m, n = (corners, d, 1) if one else (cells.shape[1], len(stress), points)
        out, weighted = np.zeros((nodes, m), stress.dtype), np.empty((m, m * n), stress.dtype)
        for c in range(count):
            for i in range(m):
                for j in range(m):
                    for q in range(n):
                        p = c * n + q
                        weighted[i, j * n + q] = stress[i, j, p] * volumes[p]
            for a in range(a_cell):
                for i in range(m):
                    total = stress.dtype.type(0)
                    for k in range(m * n):
                        total += weighted[i, k] * gradients[c, a, k]
                    out[cells[c, a], i] += total
        return out

    return slopes, forces
