"""Mechanics of a body of finite elements: energy, forces and tangent, equilibrium, K⁻¹.

`Equilibrium` has what Newton's method needs at any displacement: out-of-balance forces, steps,
potential energy. `Compliance` and `LinearResponse` are K⁻¹ of the undeformed body, at its nodes and
on the grid, for networks.
"""

from typing import TYPE_CHECKING

from shared_schema.common.lazy_names import lazy_names

if TYPE_CHECKING:
    from surrogate.mechanics.equilibrium.block_solve import BlockSolve
    from surrogate.mechanics.equilibrium.compliance import Compliance
    from surrogate.mechanics.equilibrium.follower_pressure import FollowerPressure
    from surrogate.mechanics.equilibrium.linear_response import LinearResponse
    from surrogate.mechanics.equilibrium.newton_steps import NewtonSteps, norms
    from surrogate.mechanics.equilibrium.out_of_balance import Equilibrium
    from surrogate.mechanics.equilibrium.stresses import cell_stresses, reactions
    from surrogate.mechanics.solids.mean_dilation import MeanDilationSolid
    from surrogate.mechanics.solids.solid import Solid

__all__ = [
    "BlockSolve",
    "Compliance",
    "Equilibrium",
    "FollowerPressure",
    "LinearResponse",
    "MeanDilationSolid",
    "NewtonSteps",
    "Solid",
    "cell_stresses",
    "norms",
    "reactions",
]
__getattr__, __dir__ = lazy_names(__name__)
