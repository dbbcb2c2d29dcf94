"""Coefficients of modes under given loads, of least potential energy; differentiable by them."""

from __future__ import annotations

from collections.abc import Sequence
from types import ModuleType

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from surrogate.mechanics.energy.law import Law
from surrogate.mechanics.modal_equilibrium.cubature import Cubature

LEADING = 16  # modes among which the first stiffness of the search is exact
TOLERANCE, EVALUATIONS = 2e-3, 60
Array = NDArray[np.float64]


class ModalEquilibrium:
    """Equilibria of a body in modes.

    Parameters
    ----------
    modes : array, (m, n_nodes, d)
        Displacements of the nodes in m, of every coefficient.
    cells : array of int, (n_cells, n_corners)
    gradients : array, (n_cells, n_points, n_corners, d)
        Of the shape functions, in 1/m.
    cubature : Cubature
    laws : sequence of Law
        Of materials without fibres, on elements without a dilation of their own.
    parts : array of int, (n_cells,), optional
        Position of each cell's law in the sequence.
    leading : int
        Number of the first modes among which the search starts from the exact stiffness.

    Attributes
    ----------
    stiffness : array, (m, m)
        Π''(0) in J.
    """

    def __init__(
        self,
        modes: Array,
        cells: NDArray[np.int64],
        gradients: Array,
        cubature: Cubature,
        laws: Sequence[Law],
        parts: NDArray[np.int64] | None = None,
        leading: int = LEADING,
    ) -> None:
        of_cell = np.zeros(len(cells), np.int64) if parts is None else parts
        of_point = of_cell[cubature.cells]
        self._order = np.argsort(of_point, kind="stable")  # law after law
        chosen, points = cubature.cells[self._order], cubature.points[self._order]
        slopes = np.einsum("mqai,qaj->qijm", modes[:, cells[chosen]], gradients[chosen, points])
        starts = np.searchsorted(of_point[self._order], np.arange(len(laws) + 1))
        rest = cubature.weights[self._order], laws, starts
        self.points = self._compiled.points_of(slopes, *rest, 0)
        self.stiffness = self.tangent(np.zeros(len(modes)))
        self._factor = np.linalg.cholesky(self.stiffness)
        self._basis = np.ascontiguousarray(np.linalg.inv(self._factor).T)
        k = min(leading, len(modes))
        self._in_basis = self._compiled.points_of(slopes @ self._basis, *rest, k)
        self._compliance = self._basis @ self._basis.T

    @property
    def _compiled(self) -> ModuleType:
        """The loops; no attribute, since a module has no place in a pickle."""
        from surrogate.mechanics.modal_equilibrium import compiled_energy  # Numba: half a second

        return compiled_energy

    def tangent(self, a: Array) -> Array:
        """Π''(a) in J: (m,) → (m, m)."""
        found: Array = self._compiled.stiffness_of(self.points, a, self.points.slopes)
        return (found + found.T) / 2

    def forces_of_points(self, a: Array) -> Array:
        """Internal forces in modes of every point, in J: (m,) → (m, n_points)."""
        found: Array = self._compiled.forces_of_points(self.points, a)
        in_order = np.empty_like(found)
        in_order[:, self._order] = found
        return in_order

    def linear(self, force: Array) -> Array:
        """a₁ of a force g in J: (…, m) → same."""
        return force @ self._compliance

    def __call__(self, force: Array, correction: Array) -> Array:
        """Return a - a₁ of the least Π, the correction of the linear response: (m,) → (m,).

        Parameters
        ----------
        force : array, (m,)
            g in J.
        correction : array, (m,)
            A first one, such as a network's.
        """
        of_basis = force @ self._basis  # that of the linear response, too
        start = of_basis + correction @ self._factor
        found = self._compiled.least_energy(self._in_basis, of_basis, start, TOLERANCE, EVALUATIONS)
        change: Array = self._basis @ (found - of_basis)
        return change


class BalancedCoefficients:
    r"""Coefficients of a reduced network to those of least energy.

    Their derivative is that of the equilibrium,
    :math:`∂(a - a_1) / ∂g = Π''(a)^{-1} - Π''(0)^{-1}`; that by the network's coefficients, where
    the search starts, is zero.

    Parameters
    ----------
    equilibrium : ModalEquilibrium
    unit : float
        Scaled work of forces on modes to J.
    """

    def __init__(self, equilibrium: ModalEquilibrium, unit: float) -> None:
        self.equilibrium, self.unit = equilibrium, unit

    def __call__(self, work: Tensor, coefficients: Tensor) -> Tensor:
        """Return the coefficients of least energy: scaled work and first ones, (N, m) → same."""
        force = self.unit * work.double()
        first = coefficients.detach().double().cpu().numpy()
        found = self._of_forces(force.detach().cpu().numpy(), first)
        result = torch.from_numpy(found).to(force)
        if force.requires_grad:
            result = result + self._change(found, force)
        return result.to(coefficients)

    def _of_forces(
        self, forces: NDArray[np.float64], first: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        found = np.empty_like(forces)
        for out, force, coefficients in zip(found, forces, first, strict=True):
            out[:] = self.equilibrium(force, coefficients)
        return found

    def _change(self, found: NDArray[np.float64], force: Tensor) -> Tensor:
        """Zero, with the derivative of the equilibria."""
        at = found + self.equilibrium.linear(force.detach().cpu().numpy())
        tangents = torch.from_numpy(np.array([self.equilibrium.tangent(a) for a in at])).to(force)
        at_rest = torch.from_numpy(self.equilibrium.stiffness).to(force)
        change = force - force.detach()
        moved = torch.linalg.solve(tangents, change[..., None])[..., 0]
        return moved - torch.linalg.solve(at_rest, change.T).T
