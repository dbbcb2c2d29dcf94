r"""When Newton's method has converged: a tolerance relative to the load, above rounding errors.

The iteration ends when

.. math:: ‖R‖_2 \le \max(ε_r ‖f‖_2, \; ρ(u)), \qquad
          ρ(u) = ε \, (h \, ‖\operatorname{diag} K_0‖_2 + \max(\operatorname{diag} K_0) \, ‖u‖_2),

with the external forces f, the relative tolerance :math:`ε_r`, and the floor ρ that rounding leaves
of any residual: strains :math:`∇u` are rounded to :math:`ε` where they are added to 1 in F, and to
:math:`ε |u| / h` where they are differences of displacements; both cause errors of stresses, whose
forces on a node are in proportion to its stiffness :math:`K_0`. ε is that of float64, 2.2e-16, h
the mean size of the cells. So a body of micrometres and one of kilometres are solved alike.

An absolute tolerance takes the place of :math:`ε_r ‖f‖_2` if a case names one. It counts as
:math:`10^{-6} ‖f‖_2` at most, so that it cannot pass a body that has not moved.

A load that is so small that the floor decides moves the body as linear elasticity says, by one
iteration: at least one is made under every load.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

EPSILON = float(np.finfo(np.float64).eps)
RELATIVE = 1e-9
LOOSEST = 1e-6  # of the load: largest absolute tolerance that counts


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
    def of(cls, norm: float, largest: float, cell_size: float) -> RoundOff:
        """Estimate those of a body by ‖diag K₀‖ and max(diag K₀) in N/m, and h in m."""
        return cls(EPSILON * cell_size * norm, EPSILON * largest)

    def floor(self, displacement_norm: float) -> float:
        """ρ in N, by the 2-norm of the displacement in m."""
        return self.at_rest + self.per_displacement * displacement_norm


@dataclass(frozen=True)
class ForceTolerance:
    """Tolerance on the 2-norm of the residual, as a case has it.

    Attributes
    ----------
    relative : float
        ε_r; not used beside an absolute tolerance.
    absolute : float or None
        In N.
    """

    relative: float = RELATIVE
    absolute: float | None = None

    @classmethod
    def of_case(cls, case: Mapping[str, Any]) -> ForceTolerance:
        """Take that of a case configuration."""
        solver = case.get("solver", {})
        return cls(solver.get("relative_tolerance", RELATIVE), solver.get("tolerance"))

    def under(self, load: float, round_off: RoundOff, displacement: float) -> float:
        """Tolerance in N, by the 2-norms of the external forces in N and the displacement in m."""
        floor = round_off.floor(displacement)
        if self.absolute is None:
            return max(self.relative * load, floor)
        return max(min(self.absolute, LOOSEST * load), floor)


def mean_edge(coordinates: NDArray[np.float64], cells: NDArray[np.int64]) -> float:
    """Mean length in m of one edge of every cell: a size of the cells."""
    edges = coordinates[cells[:, 1]] - coordinates[cells[:, 0]]
    return float(np.linalg.norm(edges, axis=1).mean())
