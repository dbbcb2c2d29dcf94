"""Fields of one load at the quadrature points of a body, in compiled loops.

Displacements and forces are (n_points, d), at all points of the elements; tensors at the quadrature
points are (d, d, n), those of a cell one after the other.
"""

from __future__ import annotations

from typing import Any

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
        self.gradients: Values = np.ascontiguousarray(gradients.transpose(0, 2, 3, 1), dtype)
        self.weights: Values = volumes.ravel().astype(dtype)

    def slopes(self, u: Values) -> Values:
        """∂u_i/∂x_j: (n_points, d) → (d, d, n)."""
        return slopes_in_cells(self.cells, self.gradients, u.astype(self.dtype))

    def deformation_gradient(self, u: Values) -> Values:
        """F = I + ∇u: (n_points, d) → (d, d, n)."""
        f = self.slopes(u)
        for i in range(len(f)):
            f[i, i] += 1
        return f

    def forces(self, stress: Values) -> Values:
        """Σ_q w_q P_q ∇N_a: (d, d, n) → (n_points, d)."""
        return forces_of_cells(self.cells, self.gradients, self.weights, stress, self.points)


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


@compiled
def slopes_in_cells(cells: NDArray[np.int64], gradients: Values, u: Values) -> Values:
    """Gradients at the quadrature points: (n_nodes, d) → (d, d, n_cells · n_points).

    Parameters
    ----------
    cells : array of int, (n_cells, n_corners)
    gradients : array, (n_cells, n_corners, d, n_points)
        Of the shape functions.
    u : array, (n_nodes, d)
    """
    count, corners, d, points = gradients.shape
    rows = gradients.reshape(count, corners, d * points)
    out, slopes = np.zeros((d, d, count * points), u.dtype), np.empty((d, d * points), u.dtype)
    for c in range(count):
        slopes[:] = 0
        for a in range(corners):
            for i in range(d):
                x = u[cells[c, a], i]
                for k in range(d * points):
                    slopes[i, k] += x * rows[c, a, k]
        for i in range(d):
            for j in range(d):
                for q in range(points):
                    out[i, j, c * points + q] = slopes[i, j * points + q]
    return out


@compiled
def forces_of_cells(
    cells: NDArray[np.int64], gradients: Values, volumes: Values, stress: Values, nodes: int
) -> Values:
    """Forces of stresses: (d, d, n_cells · n_points) → (n_nodes, d).

    Parameters
    ----------
    cells, gradients : array
        As of `slopes_in_cells`.
    volumes : array, (n_cells · n_points,)
    stress : array, (d, d, n_cells · n_points)
    nodes : int
    """
    count, corners, d, points = gradients.shape
    rows = gradients.reshape(count, corners, d * points)
    out, weighted = np.zeros((nodes, d), stress.dtype), np.empty((d, d * points), stress.dtype)
    for c in range(count):
        for i in range(d):
            for j in range(d):
                for q in range(points):
                    p = c * points + q
                    weighted[i, j * points + q] = stress[i, j, p] * volumes[p]
        for a in range(corners):
            for i in range(d):
                total = stress.dtype.type(0)
                for k in range(d * points):
                    total += weighted[i, k] * rows[c, a, k]
                out[cells[c, a], i] += total
    return out
