r"""The compliance of the undeformed body, carried to a deformed state.

The tangent K(u) of a body that is bent far is not like K(0), since its parts are turned. A change
of displacement y of the undeformed body becomes one of the deformed body whose gradient is, as
nearly as one can be, that of y seen from the turned and stretched material, :math:`\bar F ∇y`:

.. math::
    T y = \arg\min_z \sum_q w_q μ_q \, |∇z - \bar F_c ∇y|^2, \quad
    (T y)_a = \sum_b (L^{-1})_{ab} \sum_c \sum_e k^c_{be} \, \bar F_c \, y_e, \qquad
    P = T \, K(0)^{-1} T^T \approx K(u)^{-1}

with the mean deformation gradient of a cell :math:`\bar F_c`, and the Laplacian
:math:`L = \sum_c k^c` of every component at the nodes where it is free, of the cells
:math:`k^c_{ab} = \sum_{q ∈ c} w_q μ_q \, ∇N_a · ∇N_b`. Where F is a rotation everywhere, T is this
rotation, and P is exact for a body whose supports turn with it; at rest T = 1. P is symmetric and
positive definite. It costs a solve with the factor of K(0), which is kept, and two with that of L,
whose band is narrower by the number of components.

Turning *gradients* is better than turning the displacements of nodes by their rotations R: the
modes of a slender body that are soft at rest remain soft, whereas R y of a bending mode y stretches
a bent body.

The same projection makes a good first state of the linear response :math:`u_1 = K(0)^{-1} f` under
large loads. Its strain e and rotation w, the symmetric and the skew part of :math:`∇u_1`, are taken
apart and composed again as finite ones:

.. math:: ∇u ≈ \exp(w) (I + e) - I.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache

import numpy as np
import torch
from numpy.typing import NDArray

from surrogate.mechanics.compiled.cells import Cells
from surrogate.mechanics.compiled.fields import Array as Values
from surrogate.mechanics.compiled.fields import compiled
from surrogate.mechanics.compiled.loops import add_forces_of, slopes_at
from surrogate.mechanics.equilibrium.out_of_balance import Equilibrium
from surrogate.mechanics.matrices.factors import SymmetricFactor, in_single_precision
from surrogate.mechanics.matrices.layout import Layout

Array = NDArray[np.float64]
Numbers = NDArray[np.int64]
LARGE = 2000  # degrees of freedom from which on single precision saves time


class CarriedCompliance:
    """P of one body, for any state.

    Parameters
    ----------
    equilibrium : Equilibrium
        Its elements, supports and factor of K(0) are used; all fields are at its points.
    """

    def __init__(self, equilibrium: Equilibrium) -> None:
        self._equilibrium, solid = equilibrium, equilibrium.solid
        large = len(equilibrium.layout.dofs) > LARGE
        gradients, volumes = solid.gradients.numpy(), solid.volumes.numpy()
        metric, weights = laplacians_of_cells(equilibrium), solid.moduli_of_cells().numpy()
        self._metric: Values = metric.astype(np.float32 if large else np.float64)
        cells = solid.compiled.cells
        self._weighted = cells._replace(volumes=cells.of_points(volumes * weights[:, None]))
        whole = volumes.sum(axis=1, keepdims=True)
        means = np.einsum("cq,cqaj->caj", volumes / whole, gradients)[:, :, None]
        ones = np.ones_like(whole), 1.0
        self._means = Cells.of(solid.cells.numpy(), means.astype(self._metric.dtype), *ones)
        self._summed = laplacians_of_turned(gradients.shape[3], gradients.shape[2])
        self._laplacians = [
            ((dofs[:, None], which), in_single_precision(factor, len(dofs)) if large else factor)
            for dofs, which, factor in laplacians(equilibrium, metric)
        ]

    def at(self, u: Array) -> Callable[[Array], Array]:
        """P of a state (n_points, d) in m: forces in N to displacements in m, (n_points, d)."""
        f = self._mean_deformation(u)
        return lambda force: self._carried([f], force[None])[0]

    def at_each(self, states: Sequence[Array], forces: Sequence[Array]) -> Array:
        """P of every state of as many forces in N: (N, n_points, d) in m.

        The factors are read once for all, which takes most of the time.
        """
        return self._carried([self._mean_deformation(u) for u in states], np.stack(forces))

    def linear_response(self, force: Array) -> Array:
        """K(0)⁻¹ f: (N, n_points, d) in N → same in m, in the precision of P."""
        precise = force.astype(self._metric.dtype)
        return self._equilibrium.linear_response(precise).astype(np.float64)

    def turned(self, u: Array, y: Array) -> Array:
        """T y of m fields at a state u, in m: (n_points, d) and (m, n_points, d) → the latter."""
        f = self._mean_deformation(u)
        summed = np.stack([self._of_cells(f, each.astype(f.dtype)) for each in y])
        return self._poisson_of_each(summed).astype(np.float64)

    def warped(self, u: Array) -> Array:
        """The state of finite rotations next to a linear response: (n_points, d) in m → same."""
        solid, unit = self._equilibrium.solid.compiled, np.eye(u.shape[1])
        h = np.moveaxis(solid.slopes(u), -1, 1)
        turn = (h - h.mT) / 2
        slopes = exponential(turn) @ (unit + h - turn) - unit
        found = np.zeros_like(u)
        add_forces_of(self._weighted, np.ascontiguousarray(np.moveaxis(slopes, 1, -1)), found)
        return self._poisson(found.astype(self._metric.dtype)).astype(np.float64)

    def _mean_deformation(self, u: Array) -> Values:
        """F of every cell, its mean: (n_points, d) in m → (n_blocks, d, d, n)."""
        cells, d = self._means, u.shape[1]
        f = np.empty((len(cells.numbers), d, d, cells.row), self._metric.dtype)
        slopes_at(cells, u.astype(f.dtype), f)
        for i in range(d):
            f[:, i, i] += 1
        return f

    def _carried(self, f: Sequence[Values], forces: Array) -> Array:
        """T K(0)⁻¹ Tᵀ r of N forces, each at its state."""
        units = np.abs(forces).max((1, 2), keepdims=True)
        some = (units > 0) & (units < np.inf)
        scaled = np.where(some, forces / np.where(some, units, 1.0), 0.0)
        s = self._poisson_of_each(scaled.astype(self._metric.dtype))
        turned = [np.ascontiguousarray(each.swapaxes(1, 2)) for each in f]
        back = np.stack([self._of_cells(*both) for both in zip(turned, s, strict=True)])
        y = self._equilibrium.linear_response(back)
        carried = np.stack([self._of_cells(*both) for both in zip(f, y, strict=True)])
        return self._poisson_of_each(carried).astype(np.float64) * units

    def _poisson_of_each(self, right: Values) -> Values:
        """L⁻¹ of N fields, (N, n_points, d) → same."""
        if len(right) == 1:
            return self._poisson(right[0])[None]
        return np.ascontiguousarray(self._poisson(right.transpose(1, 2, 0)).transpose(2, 0, 1))

    def _of_cells(self, f: Values, y: Values) -> Values:
        """Σ_c k_c F_c y: (n_blocks, d, d, n), (n_points, d) → (n_points, d)."""
        cells = self._equilibrium.geometry.cells
        return self._summed(cells, self._means.numbers, self._metric, f, y)

    def _poisson(self, right: Values) -> Values:
        """L⁻¹ of every component: (n_points, d) or (n_points, d, m) → same, zero where held."""
        found = np.zeros_like(right)
        for places, factor in self._laplacians:
            columns = right[places]
            solved = factor.solve(columns.reshape(len(columns), -1))
            found[places] = solved.reshape(columns.shape)
        return found


def laplacians_of_cells(equilibrium: Equilibrium) -> Array:
    """K of every cell, (n_cells, n_corners, n_corners)."""
    solid = equilibrium.solid
    weights, gradients = solid.moduli_of_cells()[:, None] * solid.volumes, solid.gradients
    return torch.einsum("cq,cqaj,cqbj->cab", weights, gradients, gradients).numpy()


def laplacians(
    equilibrium: Equilibrium, of_cells: Array
) -> list[tuple[Numbers, Numbers, SymmetricFactor]]:
    """Points in the order of L, the components that are free at these alone, and the factor of L.

    One entry for each kind of components.
    """
    geometry, found = equilibrium.geometry, []
    alike, number = np.unique(equilibrium.free, axis=1, return_inverse=True)
    for kind, free in enumerate(alike.T):
        layout = Layout.of(geometry.coordinates, geometry.cells, ~free[:, None])
        factor = layout.factor(layout.assembled(torch.from_numpy(of_cells[None]))[0])
        assert factor is not None  # a component that is free everywhere makes K(0) singular
        found.append((layout.dofs, np.flatnonzero(number.ravel() == kind), factor))
    return found


@cache
def laplacians_of_turned(d: int, corners: int) -> Callable[..., Values]:
    """Σ_c k_c F_c y in d dimensions, of cells with so many corners.

    Loops of a length that the compiler knows take a third to half of the time.
    """

    @compiled
    def summed(
        cells: NDArray[np.int64], numbers: NDArray[np.int64], metric: Values, f: Values, y: Values
    ) -> Values:
        """Σ_c k_c F_c y: (n_points, d) → same.

        Parameters
        ----------
        cells : array of int, (n_cells, corners)
        numbers : array of int, (n_blocks, n)
            Of the cells, −1 beside them.
        metric : array, (n_cells, corners, corners)
            Laplacians k of the cells.
        f : array, (n_blocks, d, d, n)
        y : array, (n_points, d)
        """
        out, forces = np.zeros_like(y), np.empty((d, corners), y.dtype)
        for block in range(len(numbers)):
            for q, c in enumerate(numbers[block]):
                if c < 0:
                    break
                forces[:] = 0
                for b in range(corners):
                    for i in range(d):
                        turned = y.dtype.type(0)
                        for j in range(d):
                            turned += f[block, i, j, q] * y[cells[c, b], j]
                        for a in range(corners):
                            forces[i, a] += metric[c, b, a] * turned
                for a in range(corners):
                    for i in range(d):
                        out[cells[c, a], i] += forces[i, a]
        return out

    return summed


def exponential(w: Array) -> Array:
    """Rotation matrices exp(w) of skew ones, (…, d, d) → same: Rodrigues' formula."""
    angle = np.sqrt((w * w).sum((-2, -1)) / 2)[..., None, None]
    half = np.sinc(angle / (2 * np.pi))
    found = np.eye(w.shape[-1]) + np.sinc(angle / np.pi) * w + half**2 / 2 * (w @ w)
    return np.asarray(found)
