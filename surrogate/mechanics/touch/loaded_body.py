"""A body that can be held and pushed, under a load beside that."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from shared_schema.common.bodies.command_loads import CommandLoads
from surrogate.mechanics.descent.aim import Aim
from surrogate.mechanics.descent.driven_body import DrivenBody
from surrogate.mechanics.equilibrium.follower_pressure import FollowerPressure
from surrogate.mechanics.equilibrium.out_of_balance import Equilibrium
from surrogate.mechanics.statics.load import GivenLoad, Load
from surrogate.mechanics.statics.prediction import Predictor

Array = NDArray[np.float64]
Beside: TypeAlias = "GivenLoad | CommandLoads | Load | LoadedBody | None"
Predict: TypeAlias = Callable[[Array], Array]


@dataclass(frozen=True)
class LoadedBody:
    """A body under a load, beside which forces of grips or tools act.

    Attributes
    ----------
    model : Predictor
    load : Load
        Of one load case; without pressures that are all zero.
    """

    model: Predictor
    load: Load

    @classmethod
    def of(cls, model: Predictor, load: Beside = None) -> LoadedBody:
        """Read a load as `Surrogate.solve` does; InputError if it is wrong."""
        if isinstance(load, LoadedBody):
            return load
        if load is None:
            load = Load(np.zeros(model.body.geometry.coordinates.shape))
        elif not isinstance(load, Load):
            load = Load.of(model.body.geometry, load)
        presses = load.pressure is not None and load.pressure.pressures.any()
        return cls(model, load if presses else Load(load.dead))

    @property
    def pressure(self) -> FollowerPressure | None:
        """Pressures of the load."""
        return self.load.pressure

    def is_under(self, other: LoadedBody | None) -> bool:
        """Whether the load is the same as another one."""
        if other is None or not np.array_equal(self.load.dead, other.load.dead):
            return False
        one, two = self.pressure, other.pressure
        if one is None or two is None:
            return one is two
        same = len(one.surfaces) == len(two.surfaces)
        same = same and all(map(np.array_equal, one.surfaces, two.surfaces))
        return same and np.array_equal(one.pressures, two.pressures)

    def part(self, share: float) -> LoadedBody:
        """The body under a part of the load."""
        return self if share == 1.0 else replace(self, load=self.load.part(share))

    def acts(self, force: Array) -> bool:
        """Whether anything moves the body, beside pressures a dead load in N."""
        return self.pressure is not None or bool(force.any())

    def with_forces(self, force: Array) -> Array:
        """The dead load in N with other forces, (n_nodes or n_points, d); supports bear some."""
        few, many = sorted((self.load.dead, force), key=len)
        total = many.copy()
        total[: len(few)] += few
        geometry = self.model.body.geometry
        total[: len(geometry.coordinates)][~geometry.free] = 0.0
        return total

    def predict(self, dead: Array) -> Array:
        """Displacements in m, (n_nodes, d), under a dead load in N and the pressures."""
        return self.model.respond(replace(self.load, dead=dead))[0]

    def driven(self, tolerance: float) -> Predict:
        """Predictions that directions drive to a relative tolerance."""
        aim = Aim(tolerance)

        def predict(dead: Array) -> Array:
            load = replace(self.load, dead=dead)
            found, (last,) = self.model.respond(load)
            return self.model.body.descend(load, found, aim, float(last))[0]

        return predict

    @cached_property
    def equilibrium(self) -> Equilibrium:
        """The equilibrium of the body under the pressures."""
        return self.model.body.under(self.pressure)

    @cached_property
    def driven_body(self) -> DrivenBody:
        """The body under the pressures as directions see it."""
        return self.model.body.driven_body.under(self.pressure)

    def at_points(self, field: Array, dead: Array) -> Array:
        """Displacement of all points in m, (n_points, d), by that of the nodes, under a load."""
        f = self.equilibrium.forces_at_points(dead[None])
        return self.equilibrium.at_points(field[None], f)[0]

    def is_stable(self, field: Array, dead: Array) -> bool:
        """Whether an equilibrium of the body in m, (n_nodes, d), is one without grips and tools."""
        return self.equilibrium.response_at(self.at_points(field, dead)) is not None
