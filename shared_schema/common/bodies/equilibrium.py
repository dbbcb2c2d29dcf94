r"""What an equilibrium is, and its stresses; when Newton's method has converged.

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

Fields of stress from F, P and W have these names in solution files:

=========================  ====================================================  =============
name                       meaning                                               unit
=========================  ====================================================  =============
``deformation_gradient``   F, (3, 3)                                             1
``first_piola``            :math:`P = ∂W/∂F`, (3, 3)                             Pa
``cauchy``                 :math:`σ = P F^T / J`, (3, 3)                         Pa
``von_mises``              :math:`\sqrt{3/2 \, s:s}`, :math:`s = σ - \tfrac13    Pa
                           \operatorname{tr}(σ) I`
``energy_density``         W                                                     J/m³
``jacobian``               :math:`J = \det F`                                    1
=========================  ====================================================  =============

They are those at the middle of each cell. Plane strain has :math:`F_{33} = 1` and a stress
:math:`σ_{33}`. The nodal field ``reaction`` holds the forces of the supports on the body, in N.
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


def imperfection(shape: tuple[int, ...], seed: int = 0) -> NDArray[np.float64]:
    """Random vector at every node, (n_nodes, d), normal with σ = 1.

    No real body is perfectly straight. Where an equilibrium loses its stability, the part of the
    imperfection along the lowest mode decides in which direction the body goes.
    """
    return np.random.default_rng(seed).standard_normal(shape)


SMALLEST, LARGEST = 1e-5, 1.5  # of the longest side of the body
UNITS = (
    "are the units consistent? A mesh in mm needs stresses in MPa, or 'mesh.scale: 0.001' beside "
    "stresses in Pa"
)


def size_warning(
    displacement: NDArray[np.float64],
    coordinates: NDArray[np.float64],
    what: str,
    advice: str = UNITS,
) -> str | None:
    """Say how large displacements are for the body, if that is unusual.

    Displacements of no load are nothing unusual. Of several samples, all must be too small, or half
    of them too large.

    Parameters
    ----------
    displacement : array, (n_nodes, d) or (N, n_nodes, d)
    coordinates : array, (n_nodes, d)
        In the same unit.
    what : str
        Subject of the sentence, such as "the largest displacement".
    advice : str
        End of the sentence.
    """
    fields = displacement.reshape(-1, *coordinates.shape)
    if not fields.any():
        return None
    size = float(np.ptp(coordinates, axis=0).max())
    relative = np.linalg.norm(fields, axis=2).max(axis=1) / size
    largest, usual = float(relative.max()), float(np.median(relative))
    if largest >= SMALLEST and not usual > LARGEST:
        return None
    found = largest if largest < SMALLEST else usual
    return f"{what} is {found:.2g} of the body's size, {size:.4g}; {advice}"


Array = NDArray[np.float64]


def stress_fields(f: Array, p: Array, w: Array) -> dict[str, Array]:
    """Derive all fields from F and P, (..., 3, 3), and W, (...).

    The Cauchy stress of an inverted cell (J ≤ 0) has no meaning.
    """
    j = np.linalg.det(f)
    with np.errstate(divide="ignore", invalid="ignore"):
        cauchy = p @ np.swapaxes(f, -1, -2) / j[..., None, None]
        deviator = cauchy - np.trace(cauchy, axis1=-2, axis2=-1)[..., None, None] / 3 * np.eye(3)
        von_mises = np.sqrt(1.5 * np.square(deviator).sum(axis=(-2, -1)))
    return {
        "deformation_gradient": f,
        "first_piola": p,
        "cauchy": cauchy,
        "von_mises": von_mises,
        "energy_density": w,
        "jacobian": j,
    }
