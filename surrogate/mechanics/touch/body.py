"""A body that can be held and pushed, and the loads beside that."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from shared_schema.common.bodies.command_loads import CommandLoads, command_loads
from shared_schema.common.errors import InputError
from surrogate.mechanics.body.geometry import Geometry
from surrogate.mechanics.descent.aim import Aim
from surrogate.mechanics.descent.driven_body import DrivenBody
from surrogate.mechanics.equilibrium.follower_pressure import FollowerPressure
from surrogate.mechanics.equilibrium.out_of_balance import Equilibrium

Array = NDArray[np.float64]
Beside: TypeAlias = "Array | str | Sequence[str] | CommandLoads | LoadedBody | None"
Predict: TypeAlias = Callable[[Array], Array]


class Body(Protocol):
    """What can be held and pushed, such as a `Surrogate`."""

    geometry: Geometry

    @property
    def equilibrium(self) -> Equilibrium:
        """The equilibrium of the body."""

    @property
    def driven_body(self) -> DrivenBody:
        """The body as directions see it."""

    @property
    def has_series(self) -> bool:
        """Whether predictions are those of a load series, which leave little to correct."""

    def predict(self, forces: Any) -> Any:
        """Dead loads in N to displacements in m: (n_nodes or n_points, d) → (n_nodes, d)."""

    @property
    def predictor(self) -> Any:
        """What predicts beside pressures (`surrogate.learning.inference.prediction`)."""

    def descend(
        self, dead: Any, pressure: Any, predicted: Any, aim: Any, last_term: Any = ...
    ) -> Any:
        """Displacement in m that directions drive to the equilibrium, and how they end."""


@dataclass(frozen=True)
class LoadedBody:
    """A body under a load, beside which forces of grips or tools act.

    Attributes
    ----------
    model : Surrogate
    dead : array, (n_nodes or n_points, d)
        Dead part of the load in N, with what acts between the nodes after the nodal forces.
    pressure : FollowerPressure or None
        Its pressures, which follow the surface.
    """

    model: Body
    dead: Array
    pressure: FollowerPressure | None = None

    @classmethod
    def of(cls, model: Body, load: Beside = None) -> LoadedBody:
        """Read a load as `Surrogate.solve` does; InputError if it is wrong."""
        if load is None:
            return cls(model, np.zeros(model.geometry.coordinates.shape))
        if isinstance(load, LoadedBody):
            return load
        if not isinstance(load, CommandLoads):
            load = given_beside(model.geometry, load)
        between = load.between if load.between.any() else load.between[:0]
        dead = np.concatenate([load.forces, between])
        pressure = FollowerPressure.of_load(load)
        presses = pressure is not None and pressure.pressures.any()
        return cls(model, dead, pressure if presses else None)

    def is_under(self, other: LoadedBody | None) -> bool:
        """Whether the load is the same as another one."""
        if other is None or not np.array_equal(self.dead, other.dead):
            return False
        one, two = self.pressure, other.pressure
        if one is None or two is None:
            return one is two
        same = len(one.surfaces) == len(two.surfaces)
        same = same and all(map(np.array_equal, one.surfaces, two.surfaces))
        return same and np.array_equal(one.pressures, two.pressures)

    def part(self, share: float) -> LoadedBody:
        """The body under a part of the load."""
        if share == 1.0:
            return self
        pressure = None if self.pressure is None else self.pressure.scaled(share)
        return replace(self, dead=share * self.dead, pressure=pressure)

    def acts(self, force: Array) -> bool:
        """Whether anything moves the body, beside pressures a dead load in N."""
        return self.pressure is not None or bool(force.any())

    def with_forces(self, force: Array) -> Array:
        """The dead load in N with other forces, (n_nodes or n_points, d); supports bear some."""
        few, many = sorted((self.dead, force), key=len)
        total = many.copy()
        total[: len(few)] += few
        at_nodes = total[: len(self.model.geometry.coordinates)]
        at_nodes[~self.model.geometry.free] = 0.0
        return total

    def predict(self, dead: Array) -> Array:
        """Displacements in m, (n_nodes, d), under a dead load in N and the pressures."""
        return predicted(self.model, dead[None], self.pressure)[0]

    def driven(self, tolerance: float) -> Predict:
        """Predictions that directions drive to a relative tolerance."""
        aim = Aim(tolerance)

        def predict(dead: Array) -> Array:
            found, last = responses(self.model, dead[None], self.pressure)
            descent = self.model.descend(dead, self.pressure, found[0], aim, float(last[0]))
            return np.asarray(descent[0])

        return predict

    @cached_property
    def equilibrium(self) -> Equilibrium:
        """The equilibrium of the body under the pressures."""
        body = self.model.equilibrium
        return body if self.pressure is None else body.under(self.pressure)

    @cached_property
    def driven_body(self) -> DrivenBody:
        """The body under the pressures as directions see it."""
        return self.model.driven_body.under(self.pressure)

    def at_points(self, field: Array, dead: Array) -> Array:
        """Displacement of all points in m, (n_points, d), by that of the nodes, under a load."""
        f = self.equilibrium.forces_at_points(dead[None])
        return self.equilibrium.at_points(field[None], f)[0]

    def is_stable(self, field: Array, dead: Array) -> bool:
        """Whether an equilibrium of the body in m, (n_nodes, d), is one without grips and tools."""
        return self.equilibrium.response_at(self.at_points(field, dead)) is not None


def predicted(model: Body, dead: Array, pressure: FollowerPressure | None) -> Array:
    """Predictions in m of N dead loads in N, with the pressures beside each: (N, n_nodes, d)."""
    if model.geometry.surfaces:
        return responses(model, dead, pressure)[0]
    return np.asarray(model.predict(dead))


def responses(model: Body, dead: Array, pressure: FollowerPressure | None) -> tuple[Array, Array]:
    """The same, and how much the last terms of their series change them, (N,) in m."""
    geometry = model.geometry
    nodal = dead[:, : len(geometry.coordinates)]
    if pressure is not None:
        nodal = nodal + pressure.load[:, : nodal.shape[1]] * geometry.free
    found, last = model.predictor.under(dead, pressure, nodal)
    return np.asarray(found), np.asarray(last)


def given_beside(geometry: Geometry, load: Array | str | Sequence[str]) -> CommandLoads:
    """Read an array in N, (n_nodes or n_points, d), or texts as ``--load`` takes them."""
    body = geometry.loaded_body
    if isinstance(load, str) or (isinstance(load, Sequence) and all(map(_is_text, load))):
        given = command_loads(body, load, needed=False)
        if given.surfaces and geometry.pressed is None:
            raise InputError("load: a pressure, expected forces; the network was trained on these")
        return given
    points, nodes, both = geometry.loaded_points, len(geometry.coordinates), np.asarray(load)
    between = both[nodes:] if points is not None and len(both) == points.count else both[:0]
    given = CommandLoads(body)
    given.add_forces(both[: len(both) - len(between)])
    given.between[: len(between)] = between
    return given


def _is_text(part: object) -> bool:
    return isinstance(part, str)
