r"""Which values of the actuators bring places of a body to targets, or as near as they can be.

.. math:: \min_v \; \sum_t w_t^2 \, \|y_t(v) - \hat y_t\|^2 + ε^2 \, L^2 \sum_i
   \Big(\frac{v_i - v_{i,0}}{V_i}\Big)^2, \qquad v_{low} \le v \le v_{high}

with the mean places y of some nodes, and mean outward normals of some facets times the size L of
the body, what is given of the actuators, v, their values at rest :math:`v_0`, and their limits V:
of many ways to a target, that of the least effort is taken. Gauss and Newton's method has the
derivatives :math:`∂q / ∂v = K^{-1} G \, ∂a / ∂v` of the modes. Where tensions and pressures are
given, those of polynomials do (`surrogate.mechanics.actuation.response_surface`); a search among
the states that these tell, which takes no equilibrium, goes first.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

from shared_schema.common.bodies.command_loads import CommandLoads
from shared_schema.common.bodies.distributed_loads import area_vectors
from shared_schema.common.errors import InputError, WorkError
from surrogate.mechanics.actuation.bordered import Balanced
from surrogate.mechanics.body.geometry import Geometry

if TYPE_CHECKING:
    from surrogate.mechanics.actuation.actuation import Actuation

Array = NDArray[np.float64]
Values = Mapping[str, Sequence[float]]
STEPS, SETTLED = 30, 1e-3  # of the search, and the last one over the limits
SHORTEST = 1 / 32  # of a step
REACHED = 5e-3  # of the size of the body: as far from a target as it is not missed
NO_LESS, TINY = 1e-3, 1e-5  # of what is least: a decrease that ends the search
DIFFERENCE = 1e-6  # of the size of the body: a change for the derivative of a normal


@dataclass(frozen=True)
class Target:
    """Where nodes shall be, or where a surface shall look.

    Attributes
    ----------
    nodes : array of int, (n,)
        Nodes whose mean place is meant.
    value : array, (d,)
        The place in m, or a unit vector.
    facets : array of int, (n_facets, n_corners), or None
        Facets whose mean outward normal is meant.
    """

    nodes: NDArray[np.int64]
    value: Array
    facets: NDArray[np.int64] | None = None

    @property
    def moving(self) -> NDArray[np.int64]:
        """Numbers of the nodes that it depends on."""
        return self.nodes if self.facets is None else np.unique(self.facets)

    def among(self, nodes: NDArray[np.int64]) -> Target:
        """The same, by the places of its nodes among some in ascending order."""
        facets = None if self.facets is None else np.searchsorted(nodes, self.facets)
        members = self.nodes if facets is not None else np.searchsorted(nodes, self.nodes)
        return replace(self, nodes=members, facets=facets)

    def reached(self, x: Array) -> Array:
        """The place in m, or the normal, at positions (n_nodes, d) of the nodes in m."""
        if self.facets is None:
            return np.asarray(x[self.nodes].mean(axis=0))
        normal = area_vectors(x, self.facets).sum(axis=0)
        return np.asarray(normal / np.linalg.norm(normal))

    def slopes(self, x: Array, changes: Array) -> Array:
        """Derivatives along changes of the positions, (m, n_nodes, d): (d, m)."""
        if self.facets is None:
            return np.asarray(changes[:, self.nodes].mean(axis=1).T)
        step = DIFFERENCE * float(np.ptp(x)) / max(float(np.abs(changes).max()), 1e-300)
        at = self.reached(x)
        return np.stack([(self.reached(x + step * each) - at) / step for each in changes], axis=1)


def targets_of(geometry: Geometry, places: Values, directions: Values) -> tuple[Target, ...]:
    """Read targets.

    Parameters
    ----------
    geometry : Geometry
    places : mapping of str to sequence of d floats
        Where the mean of the nodes of a group, or the node next to X,Y[,Z], shall be, in m.
    directions : mapping of str to sequence of d floats
        Where the surface of a group shall look in the mean.

    Raises
    ------
    InputError
        If there is no such group, or a number is wrong.
    """
    loads, d, found = CommandLoads(geometry.loaded_body), geometry.dimension, []
    for name, value in places.items():
        place = _vector(f"target '{name}'", value, d)
        members = np.flatnonzero(loads.members(name, f"target '{name}'", nearest=True))
        found.append(Target(members, place))
    for name, value in directions.items():
        option = f"orientation '{name}'"
        if name not in geometry.groups or not len(facets := loads.body.facets_of(name)):
            raise InputError(f"{option}: expected a group with facets on the surface")
        direction = _vector(option, value, d)
        if not direction.any():
            raise InputError(f"{option}: expected a direction, not 0")
        members = np.flatnonzero(geometry.groups[name])
        found.append(Target(members, direction / np.linalg.norm(direction), facets))
    if not found:
        raise InputError("target: expected one at least")
    return tuple(found)


def _vector(option: str, value: Sequence[float], d: int) -> Array:
    vector = np.asarray(value, dtype=np.float64)
    if vector.shape != (d,) or not np.isfinite(vector).all():
        raise InputError(f"{option} = {value}: expected {d} finite numbers")
    return vector


class Effort(NamedTuple):
    """What actuators do, beside the distance from targets.

    Attributes
    ----------
    unit, rest : array, (n_actuators,)
        V and v₀.
    weight : float
        ε L in m.
    """

    unit: Array
    rest: Array
    weight: float

    def step(self, slopes: Array, left: Array, values: Array, low: Array, high: Array) -> Array:
        """The step of Gauss and Newton's method between limits: (n_actuators,).

        Parameters
        ----------
        slopes : array, (n, n_actuators)
            Derivatives of what is left by values over V.
        left : array, (n,)
            In m.
        values, low, high : array, (n_actuators,)
            Present values, and limits of those after the step.
        """
        matrix = np.concatenate([slopes, self.weight * np.eye(len(values))])
        effort = self.weight * (values - self.rest) / self.unit
        bounds = (low - values) / self.unit, (high - values) / self.unit
        bounds = np.minimum(bounds[0], 0), np.maximum(bounds[1], 1e-12)
        found = lsq_linear(matrix, -np.concatenate([left, effort]), bounds, method="bvls")
        return np.asarray(self.unit * found.x)


class Search:
    """The search for values that reach some targets.

    Parameters
    ----------
    actuation : Actuation
    targets : sequence of Target
    limits : tuple of array, (n_actuators,)
        Lower and upper ones.
    work : array, (n_modes,)
        Of a dead load on the modes in J.
    effort : float
        ε.
    """

    def __init__(
        self,
        actuation: Actuation,
        targets: Sequence[Target],
        limits: tuple[Array, Array],
        work: Array,
        effort: float,
    ) -> None:
        nodes = np.unique(np.concatenate([target.moving for target in targets]))
        self._of, self._work, self._effort = actuation, work, effort
        self._targets = [target.among(nodes) for target in targets]
        self._modes = actuation.reduced.modes[:, nodes]
        self._places = actuation.body.geometry.coordinates[nodes]
        self._low, self._high = limits
        self._rest = np.array([control.at_rest for control in actuation.controls_of(self._low)])
        self._unit = np.maximum(np.abs(self._high - self._rest), np.abs(self._low - self._rest))
        self._size = actuation.size

    def found(self, values: Array | None, state: Balanced | None) -> tuple[Array, Balanced]:
        """Values, (n_actuators,), and the state under them, from a start or from rest.

        Raises
        ------
        WorkError
            If there is no equilibrium where the search begins.
        """
        values = np.clip(self._rest if values is None else values, self._low, self._high)
        if state is None and self._near(values, None) is not None:
            values, _ = self._advanced(values, None, self._near)
        return self._advanced(values, state, self._balanced)

    def _advanced(
        self,
        values: Array,
        state: Balanced | None,
        state_of: Callable[[Array, Balanced | None], Balanced | None],
    ) -> tuple[Array, Balanced]:
        """Search among the states that values have."""
        begun = state_of(values, state)
        assert begun is not None
        state = begun
        cost = self._cost(values, state)
        for _ in range(STEPS):
            step = self._step(values, state)
            share, advanced = 1.0, None
            while advanced is None and share >= SHORTEST:
                trial = np.clip(values + share * step, self._low, self._high)
                try:
                    after = state_of(trial, state)
                except WorkError:
                    share /= 2
                    continue
                assert after is not None
                if (new := self._cost(trial, after)) <= cost:
                    advanced = trial, after, new
                share /= 2
            if advanced is None:
                break
            before, (values, state, cost) = cost, advanced
            small = (np.abs(2 * share * step) <= SETTLED * self._unit).all()
            if small or before - cost <= NO_LESS * before + (TINY * self._size) ** 2:
                break
        return values, state

    def _balanced(self, values: Array, state: Balanced | None) -> Balanced:
        return self._of.balanced(self._of.controls_of(values), self._work, state)

    def _near(self, values: Array, _: Balanced | None) -> Balanced | None:
        return self._of.near(self._of.controls_of(values))

    def _positions(self, state: Balanced) -> Array:
        """Positions of the nodes of the targets in m."""
        return np.asarray(self._places + np.tensordot(state.state, self._modes, 1))

    def missed(self, state: Balanced) -> float:
        """Largest distance in m of a place from its target."""
        x = self._positions(state)
        places = [target for target in self._targets if target.facets is None]
        far = [np.linalg.norm(target.reached(x) - target.value) for target in places]
        return float(max(far, default=0.0))

    def _step(self, values: Array, state: Balanced) -> Array:
        x, controls = self._positions(state), self._of.controls_of(values)
        changes = self._unit[:, None] * self._of.changes_near(controls, state, self._work)
        changes = np.tensordot(changes, self._modes, 1)
        rows = [self._weight(t) * t.slopes(x, changes) for t in self._targets]
        slopes, left = np.concatenate(rows), self._off(x)
        effort = Effort(self._unit, self._rest, self._effort * self._size)
        return effort.step(slopes, left, values, self._low, self._high)

    def _off(self, x: Array) -> Array:
        return np.concatenate([self._weight(t) * (t.reached(x) - t.value) for t in self._targets])

    def _left(self, values: Array, x: Array) -> Array:
        """What is squared."""
        effort = self._effort * self._size * (values - self._rest) / self._unit
        return np.concatenate([self._off(x), effort])

    def _cost(self, values: Array, state: Balanced) -> float:
        return float(np.square(self._left(values, self._positions(state))).sum())

    def _weight(self, target: Target) -> float:
        return 1.0 if target.facets is None else self._size
