"""Equilibria in modes as a function of tensors, differentiable by the forces."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from surrogate.mechanics.modal_equilibrium.least_energy import ModalEquilibrium


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
