r"""Tolerance of Newton's method on the residual, relative to the load and above rounding errors.

The iteration ends when

.. math:: ‖R‖_2 \le \max(ε_r ‖f‖_2, \; ρ(u)), \qquad
          ρ(u) = ε \, (h \, ‖\operatorname{diag} K_0‖_2 + \max(\operatorname{diag} K_0) \, ‖u‖_2),

with the external forces f, the relative tolerance :math:`ε_r`, and the floor ρ that rounding leaves
of any residual: strains :math:`∇u` are rounded to :math:`ε` where they are added to 1 in F, and to
:math:`ε |u| / h` where they are differences of displacements; both cause errors of stresses, whose
forces on a node are in proportion to its stiffness :math:`K_0`. ε is that of float64, 2.2e-16, h
the mean size of the cells.

A load that is so small that the floor decides moves the body as linear elasticity says, by one
iteration: at least one is made under every load.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from petsc4py import PETSc

EPSILON = float(np.finfo(np.float64).eps)


@dataclass(frozen=True)
class RoundOff:
    """Rounding errors of the residual of a body.

    Attributes
    ----------
    at_rest : float
        ε h ‖diag K₀‖ in N.
    per_displacement : float
        ε max(diag K₀) in N/m.
    """

    at_rest: float
    per_displacement: float

    @classmethod
    def of(cls, stiffness: PETSc.Mat, cell_size: float) -> RoundOff:
        """Estimate those of a body by its stiffness K₀ in N/m and its cells (collective)."""
        diagonal = stiffness.getDiagonal()
        found = cls(
            EPSILON * cell_size * diagonal.norm(PETSc.NormType.NORM_2),
            EPSILON * diagonal.norm(PETSc.NormType.NORM_INFINITY),
        )
        diagonal.destroy()
        return found

    def floor(self, displacement_norm: float) -> float:
        """ρ in N, by the 2-norm of the displacement in m."""
        return self.at_rest + self.per_displacement * displacement_norm
