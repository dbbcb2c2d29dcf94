"""Mechanics of a body of finite elements: what it does, without a network, a run or a training.

>>> from surrogate.mechanics import Body, Load, Series, Touch            # doctest: +SKIP
>>> body = Body.read("data/block")      # of `datagen body`              # doctest: +SKIP
>>> series = Series(body)                                                # doctest: +SKIP
>>> load = Load.of(body.geometry, "tip:0,-1.5")                          # doctest: +SKIP
>>> displacement = series.predict(load, tolerance=1e-3)                  # doctest: +SKIP
>>> body.certify(load, displacement).max_error                           # doctest: +SKIP

`Equilibrium` has what Newton's method needs at any displacement: out-of-balance forces, steps,
potential energy. `Compliance` and `LinearResponse` are K⁻¹ of the undeformed body, at its nodes and
on the grid, for networks.
"""

from typing import TYPE_CHECKING

from shared_schema.common.lazy_names import lazy_names

if TYPE_CHECKING:
    from surrogate.mechanics.equilibrium.block_solve import BlockSolve
    from surrogate.mechanics.equilibrium.compliance import Compliance
    from surrogate.mechanics.equilibrium.following_loads import FollowingLoads
    from surrogate.mechanics.equilibrium.linear_response import LinearResponse
    from surrogate.mechanics.equilibrium.newton_steps import NewtonSteps, norms
    from surrogate.mechanics.equilibrium.out_of_balance import Equilibrium
    from surrogate.mechanics.equilibrium.stresses import cell_stresses, reactions
    from surrogate.mechanics.identification.identification import Identification, identify
    from surrogate.mechanics.identification.markers import Markers
    from surrogate.mechanics.solids.mixed_elements import MeanDilationSolid
    from surrogate.mechanics.solids.solid import Solid
    from surrogate.mechanics.statics.body import Body
    from surrogate.mechanics.statics.load import Load
    from surrogate.mechanics.statics.prediction import Predictor, Series
    from surrogate.mechanics.touch.grip import Grip
    from surrogate.mechanics.touch.touch import Touch

__all__ = [
    "BlockSolve",
    "Body",
    "Compliance",
    "Equilibrium",
    "FollowingLoads",
    "Grip",
    "Identification",
    "LinearResponse",
    "Load",
    "Markers",
    "MeanDilationSolid",
    "NewtonSteps",
    "Predictor",
    "Series",
    "Solid",
    "Touch",
    "cell_stresses",
    "identify",
    "norms",
    "reactions",
]
__getattr__, __dir__ = lazy_names(__name__)
