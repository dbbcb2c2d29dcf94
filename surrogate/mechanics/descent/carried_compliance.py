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

In a time step K(0) has the inertia A of the body beside it
(`surrogate.mechanics.equilibrium.inertia`), which turns with the body and is not stretched. So does
T, with the rotations R of the points and a diagonal A:

.. math::
    T y = \arg\min_z \sum_q w_q μ_q \, |∇z - \bar F_c ∇y|^2 + \sum_a A_a |z_a - R_a y_a|^2 .

Where inertia prevails, P is its inverse.

The same projection makes a good first state of the linear response :math:`u_1 = K(0)^{-1} f` under
large loads. Its strain e and rotation w, the symmetric and the skew part of :math:`∇u_1`, are taken
apart and composed again as finite ones:

.. math:: ∇u ≈ \exp(w) (I + e) - I.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from typing import NamedTuple

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
POLAR = 6  # iterations for a rotation


class Turn(NamedTuple):
    """How a state turns the body.

    Attributes
    ----------
    f : array, (n_blocks, d, d, n)
        F of every cell, its mean.
    inert : array, (n_points, d, d), or None
        A_a R_a in N/m.
    """

    f: Values
    inert: Values | None

    @property
    def back(self) -> Turn:
        """The transposed one."""
        inert = None if self.inert is None else self.inert.swapaxes(1, 2)
        return Turn(np.ascontiguousarray(self.f.swapaxes(1, 2)), inert)


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
        springs = springs_of_cells(equilibrium)
        self._metric: Values = metric.astype(np.float32 if large else np.float64)
        cells = solid.compiled.cells
        self._weighted = cells._replace(volumes=cells.of_points(volumes * weights[:, None]))
        whole = volumes.sum(axis=1, keepdims=True)
        means = np.einsum("cq,cqaj->caj", volumes / whole, gradients)[:, :, None]
        ones = np.ones_like(whole), 1.0
        self._means = Cells.of(solid.cells.numpy(), means.astype(self._metric.dtype), *ones)
        self._summed = laplacians_of_turned(gradients.shape[3], gradients.shape[2])
        self._of_corners, self._springs = springs, None
        if springs is not None:
            metric = metric + springs[:, :, None] * np.eye(springs.shape[1])
            cells, at = solid.cells.numpy(), len(equilibrium.free)
            self._springs = np.bincount(cells.ravel(), springs.ravel(), at)
        self._laplacians = [
            ((dofs[:, None], which), in_single_precision(factor, len(dofs)) if large else factor)
            for dofs, which, factor in laplacians(equilibrium, metric)
        ]

    def at(self, u: Array) -> Callable[[Array], Array]:
        """P of a state (n_points, d) in m: forces in N to displacements in m, (n_points, d)."""
        turn = self._turn(u)
        return lambda force: self._carried([turn], force[None])[0]

    def at_each(self, states: Sequence[Array], forces: Sequence[Array]) -> Array:
        """P of every state of as many forces in N: (N, n_points, d) in m.

        The factors are read once for all, which takes most of the time.
        """
        return self._carried([self._turn(u) for u in states], np.stack(forces))

    def linear_response(self, force: Array) -> Array:
        """K(0)⁻¹ f: (N, n_points, d) in N → same in m, in the precision of P."""
        precise = force.astype(self._metric.dtype)
        return self._equilibrium.linear_response(precise).astype(np.float64)

    def turned(self, u: Array, y: Array) -> Array:
        """T y of m fields at a state u, in m: (n_points, d) and (m, n_points, d) → the latter."""
        turn = self._turn(u)
        summed = np.stack([self._of_cells(turn, each.astype(turn.f.dtype)) for each in y])
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

    def _turn(self, u: Array) -> Turn:
        """How a state (n_points, d) in m turns the body."""
        f, springs = self._mean_deformation(u), self._of_corners
        if springs is None or self._springs is None:
            return Turn(f, None)
        turned = np.zeros((*u.shape, u.shape[1]))
        add_to_points(self._equilibrium.geometry.cells, self._means.numbers, springs, f, turned)
        turned /= self._springs[:, None, None]
        to_rotations(turned)
        return Turn(f, (self._springs[:, None, None] * turned).astype(f.dtype))

    def _mean_deformation(self, u: Array) -> Values:
        """F of every cell, its mean: (n_points, d) in m → (n_blocks, d, d, n)."""
        cells, d = self._means, u.shape[1]
        f = np.empty((len(cells.numbers), d, d, cells.row), self._metric.dtype)
        slopes_at(cells, u.astype(f.dtype), f)
        for i in range(d):
            f[:, i, i] += 1
        return f

    def _carried(self, turns: Sequence[Turn], forces: Array) -> Array:
        """T K(0)⁻¹ Tᵀ r of N forces, each at its state."""
        units = np.abs(forces).max((1, 2), keepdims=True)
        some = (units > 0) & (units < np.inf)
        scaled = np.where(some, forces / np.where(some, units, 1.0), 0.0)
        s = self._poisson_of_each(scaled.astype(self._metric.dtype))
        back = np.stack([self._of_cells(turn.back, of) for turn, of in zip(turns, s, strict=True)])
        y = self._equilibrium.linear_response(back)
        carried = np.stack([self._of_cells(*both) for both in zip(turns, y, strict=True)])
        return self._poisson_of_each(carried).astype(np.float64) * units

    def _poisson_of_each(self, right: Values) -> Values:
        """L⁻¹ of N fields, (N, n_points, d) → same."""
        if len(right) == 1:
            return self._poisson(right[0])[None]
        return np.ascontiguousarray(self._poisson(right.transpose(1, 2, 0)).transpose(2, 0, 1))

    def _of_cells(self, turn: Turn, y: Values) -> Values:
        """Σ_c k_c F_c y + A R y: (n_points, d) → same."""
        cells = self._equilibrium.geometry.cells
        found = self._summed(cells, self._means.numbers, self._metric, turn.f, y)
        return found if turn.inert is None else found + np.einsum("aij,aj->ai", turn.inert, y)

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


def springs_of_cells(equilibrium: Equilibrium) -> Array | None:
    """A of the points of every cell as a diagonal in N/m, (n_cells, n_corners); None at rest."""
    if equilibrium.inertia is None:
        return None
    masses = equilibrium.inertia.masses
    diagonal = np.einsum("caa->ca", masses.blocks)
    whole = masses.blocks.sum((1, 2)) / diagonal.sum(axis=1)
    return np.asarray(masses.scheme.spring * whole[:, None] * diagonal)


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


@compiled
def add_to_points(
    cells: Numbers, numbers: Numbers, weights: Array, values: Values, out: Array
) -> None:
    """Add weighted tensors of the cells, (n_blocks, d, d, n), to points: → (n_points, d, d)."""
    for block in range(len(numbers)):
        for q, c in enumerate(numbers[block]):
            if c < 0:
                break
            for a in range(cells.shape[1]):
                for i in range(out.shape[1]):
                    for j in range(out.shape[1]):
                        out[cells[c, a], i, j] += weights[c, a] * values[block, i, j, q]


@compiled
def to_rotations(f: Array) -> None:
    """Replace tensors (n, d, d) by their rotations: Newton's method for the polar decomposition."""
    d = f.shape[1]
    cofactor = np.empty((d, d))
    for a in range(len(f)):
        for _ in range(POLAR):
            of, det = f[a], 0.0
            for i in range(d):
                for j in range(d):
                    if d == 2:
                        cofactor[i, j] = of[1 - i, 1 - j] * (1 if i == j else -1)
                    else:
                        k, n, m, r = (i + 1) % 3, (i + 2) % 3, (j + 1) % 3, (j + 2) % 3
                        cofactor[i, j] = of[k, m] * of[n, r] - of[k, r] * of[n, m]
                    det += of[i, j] * cofactor[i, j] / d
            for i in range(d):
                for j in range(d):
                    of[i, j] = (of[i, j] + cofactor[i, j] / det) / 2


def exponential(w: Array) -> Array:
    """Rotation matrices exp(w) of skew ones, (…, d, d) → same: Rodrigues' formula."""
    angle = np.sqrt((w * w).sum((-2, -1)) / 2)[..., None, None]
    half = np.sinc(angle / (2 * np.pi))
    found = np.eye(w.shape[-1]) + np.sinc(angle / np.pi) * w + half**2 / 2 * (w @ w)
    return np.asarray(found)
