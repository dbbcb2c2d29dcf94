"""Actuators on a body: where their cables run, which facets bound their chambers, what they do."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from shared_schema.actuators.actuator import Actuator, Chamber, FixedPoint
from shared_schema.actuators.actuator import Cable as CableOfCase
from shared_schema.actuators.control import KINDS, Actuated, Control
from shared_schema.common.bodies.cables import Cable
from shared_schema.common.bodies.command_loads import LoadedBody
from shared_schema.common.bodies.following_loads import FollowingLoad, PressedSurface, is_closed
from shared_schema.common.bodies.passing_walls import passing_walls
from shared_schema.common.bodies.reference_cells import CORNERS, NAMES, quadratic_shape_values
from shared_schema.common.errors import InputError
from shared_schema.points_in_cells import locate

Array = NDArray[np.float64]
BESIDE = 0.05  # of the size of a cell: points of a cable so far outside are on the surface
STREAM = 0xAC7  # of the random numbers of actuators, apart from those of load families
LARGEST = 1e12


@dataclass(frozen=True)
class PlacedActuators:
    """The actuators of a body, in the order of their names.

    Attributes
    ----------
    names : tuple of str
    actuators : tuple of Actuator
        As the case has them.
    loads : tuple of FollowingLoad
        Their unit forces.
    rest : array, (n_actuators,)
        Length or volume of each at rest, in m or m³.
    """

    names: tuple[str, ...]
    actuators: tuple[Actuator, ...]
    loads: tuple[FollowingLoad, ...]
    rest: Array

    def __len__(self) -> int:
        return len(self.names)

    def on(self, positions: Array) -> PlacedActuators:
        """The same on a body whose points are elsewhere at rest, (n_points, d) in m."""
        rest = np.array([load.quantity(positions) for load in self.loads])
        return replace(self, rest=rest)

    @property
    def kinds(self) -> tuple[str, ...]:
        """What the case gives of each (`shared_schema.actuators.control`)."""
        return tuple(actuator.kind for actuator in self.actuators)

    def draw(self, number: int, seed: int) -> Array:
        """Draw what is given of each actuator in one sample: (n_actuators,).

        Parameters
        ----------
        number : int
            Sample number.
        seed : int
            Seed of the dataset.
        """
        limits = np.array([actuator.limits for actuator in self.actuators]).reshape(-1, 2)
        random = np.random.default_rng([seed, number, STREAM])
        return random.uniform(limits[:, 0], limits[:, 1])

    def controls(self, values: Array) -> tuple[Control, ...]:
        """Controls of the case's kinds with given values, (n_actuators,)."""
        known = zip(self.kinds, values, self.rest, self.actuators, strict=True)
        return tuple(
            Control(kind, float(value), float(rest), getattr(actuator, "ambient", None) or 0.0)
            for kind, value, rest, actuator in known
        )

    def forces_at_rest(self, amplitudes: Array, positions: Array) -> Array:
        """Forces of some amplitudes on the undeformed body: (n_points, d) in N."""
        total = np.zeros(positions.shape)
        for load, amplitude in zip(self.loads, amplitudes, strict=True):
            total += amplitude * load.forces(positions)
        return total

    def wall_problem(self, x: Array) -> str | None:
        """Say which chamber's walls pass through each other at positions (n_points, d) in m."""
        for name, load in zip(self.names, self.loads, strict=True):
            passed = passing_walls(x, load.facets) if isinstance(load, PressedSurface) else 0
            if passed:
                return (
                    f"walls of the chamber '{name}' pass through each other at {passed} facets, "
                    "contact between them is not modelled"
                )
        return None

    def found(self, values: Array) -> dict[str, Actuated]:
        """Actuators in equilibrium, by names, from amplitudes and quantities, (n_actuators, 2)."""
        kinds = [KINDS[kind][1] for kind in self.kinds]
        each = zip(self.names, kinds, values, strict=True)
        return {name: Actuated(of, float(a), float(q)) for name, of, (a, q) in each}

    @property
    def idle(self) -> tuple[Control, ...]:
        """Slack cables, and chambers at ambient pressure."""
        kinds = ["tension" if isinstance(a, CableOfCase) else "pressure" for a in self.actuators]
        each = zip(kinds, self.controls(np.zeros(len(self))), strict=True)
        return tuple(replace(control, kind=kind) for kind, control in each)

    def given(self, texts: Sequence[str]) -> tuple[Control, ...]:
        """Controls that ``--actuate`` names; actuators that it does not name are idle.

        Parameters
        ----------
        texts : sequence of str
            ``NAME=VALUE`` of the kind that the case has, or ``NAME.KIND=VALUE``.

        Raises
        ------
        InputError
            If there is no such actuator, or it has no such kind or value.
        """
        found, seen = list(self.idle), set()
        for text in texts:
            option = f"--actuate '{text}'"
            name, equals, value = text.partition("=")
            name, _, kind = name.strip().partition(".")
            if not equals or name not in self.names or name in seen:
                known = ", ".join(self.names) or "none"
                raise InputError(
                    f"{option}: expected NAME=VALUE, each once, the actuators are {known}"
                )
            seen.add(name)
            number = self.names.index(name)
            found[number] = self._control(option, number, kind or self.kinds[number], value)
        return tuple(found)

    def _control(self, option: str, number: int, kind: str, value: str) -> Control:
        actuator, idle = self.actuators[number], self.idle[number]
        if kind not in actuator.kinds:
            raise InputError(f"{option}: kind '{kind}', expected {', '.join(actuator.kinds)}")
        if kind == "gas" and getattr(actuator, "ambient", None) is None:
            raise InputError(f"{option}: the case has no 'ambient' pressure of this actuator")
        try:
            amount = float(value)
        except ValueError:
            amount = np.nan
        least = {"tension": 0.0, "gas": -idle.ambient}.get(kind, -LARGEST)
        least = np.finfo(float).tiny if kind in ("length", "volume") else least
        if not least <= amount <= LARGEST:
            above = "above 0 " if kind in ("length", "volume") else f"from {least:g} "
            raise InputError(f"{option}: expected a number {above}({KINDS[kind][0]})")
        return replace(idle, kind=kind, value=amount)


def placed_actuators(actuators: Mapping[str, Actuator], body: LoadedBody) -> PlacedActuators:
    """Place the actuators of a case on its body.

    Parameters
    ----------
    actuators : mapping of str to Actuator
        As `actuators_of` returns them.
    body : LoadedBody

    Raises
    ------
    InputError
        If a point of a cable is outside of the body, or a chamber is open.
    """
    loads: list[FollowingLoad] = []
    for name, actuator in actuators.items():
        if isinstance(actuator, Chamber):
            loads.append(_chamber(f"key 'actuators.{name}.chamber'", actuator.chamber, body))
        elif isinstance(actuator, CableOfCase):
            loads.append(_cable(f"key 'actuators.{name}.cable", actuator, body))
    known = tuple(actuators), tuple(actuators.values()), tuple(loads)
    return PlacedActuators(*known, np.zeros(len(loads))).on(body.positions)


def _chamber(key: str, group: str, body: LoadedBody) -> PressedSurface:
    if group not in body.groups:
        names = ", ".join(sorted(body.groups)) or "none"
        raise InputError(f"{key} = '{group}': no such group, the groups of the mesh are {names}")
    facets = body.facets_of(group)
    if not is_closed(facets):
        raise InputError(
            f"{key} = '{group}': {len(facets)} facets of the surface that leave an edge open, "
            "expected all facets of a closed cavity"
        )
    surface = PressedSurface(facets if body.points is None else body.points.facets(facets))
    if not surface.quantity(body.positions) > 0:
        raise InputError(f"{key} = '{group}': the outside of the body, expected that of a cavity")
    return surface


def _cable(key: str, actuator: CableOfCase, body: LoadedBody) -> Cable:
    d = body.coordinates.shape[1]
    fixed = np.array([isinstance(point, FixedPoint) for point in actuator.cable])
    points = [point.fixed if isinstance(point, FixedPoint) else point for point in actuator.cable]
    wrong = next((i for i, point in enumerate(points) if len(point) != d), None)
    if wrong is not None:
        raise InputError(f"{key}.{wrong}': {len(points[wrong])} numbers, expected {d}")
    places = np.array(points, dtype=np.float64)
    same = np.flatnonzero(~np.diff(places, axis=0).any(axis=1))
    if len(same):
        raise InputError(f"{key}.{same[0] + 1}': the point before it, expected another place")
    if fixed.all():
        raise InputError(f"{key}': all points are fixed, expected some in the body")
    cells, weights, outside = locate(places[~fixed], body.coordinates, body.cells, body.cell_type)
    if (outside > BESIDE).any():
        number = np.flatnonzero(~fixed)[outside.argmax()]
        at = ", ".join(f"{x:g}" for x in places[number])
        raise InputError(
            f"{key}.{number}' = [{at}]: outside of the body, expected a point in it, or "
            f"{{fixed: [{at}]}}"
        )
    columns = body.cells[cells]
    if body.points is not None:
        inside = weights @ np.array(CORNERS[body.cell_type], dtype=np.float64)
        weights = quadratic_shape_values(NAMES[body.cell_type], inside)
        columns = body.points.cells[cells]
    rows = np.repeat(np.flatnonzero(~fixed), columns.shape[1])
    shape = (len(places), len(body.positions))
    matrix = csr_array((weights.ravel(), (rows, columns.ravel())), shape=shape)
    return Cable(matrix, np.where(fixed[:, None], places, 0.0))
