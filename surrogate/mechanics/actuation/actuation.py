r"""What actuators do to a body, in milliseconds: equilibria in modes of its displacement.

The displacement under actuators is nearly that of a few modes, those of equilibria under random
amplitudes (`Actuation.fit`). The equilibrium in these modes
(`surrogate.mechanics.actuation.reduced_body`) takes any tensions, lengths, pressures, volumes and
amounts of gas, and dead loads that the modes know. It starts from those of the sampled states,
interpolated by radial functions of the amplitudes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.interpolate import RBFInterpolator
from scipy.stats.qmc import Halton

from shared_schema.actuators import Control, PlacedActuators
from shared_schema.common.errors import InputError, WorkError
from shared_schema.common.progress import Progress
from shared_schema.common.solution_file import write_solution
from surrogate.mechanics.actuation.actuated_body import ActuatedBody, ActuatedModes
from surrogate.mechanics.actuation.bordered import Balanced, balanced, moved_by
from surrogate.mechanics.actuation.reduced_body import (
    CellSample,
    ReducedBody,
    modes_of,
    sampled_cells,
)
from surrogate.mechanics.actuation.targets import Search, Values, targets_of
from surrogate.mechanics.body.geometry import Geometry
from surrogate.mechanics.descent.aim import Aim
from surrogate.mechanics.statics.body import Body
from surrogate.mechanics.statics.load import Load
from surrogate.mechanics.statics.prediction import Series
from surrogate.runtime.tensor_file import load_tensors, serialised

Array = NDArray[np.float64]
KEPT = "actuation.safetensors"  # file of the modes, in the folder of a body or a run
SAMPLES, SEED = 128, 0
ACCURACY = 1e-4  # of the sampled equilibria
BEYOND = 0.05  # of the limits, to either side, that samples go
CONFIRMED = 1e-8  # of that of the finite elements
EFFORT = 1e-3  # ε of `surrogate.mechanics.actuation.targets`
IN_MODES = 1e-4  # of the last step of Newton's method there
Given = Mapping[str, float] | Sequence[str]


@dataclass(frozen=True)
class ActuatedState:
    """A body in equilibrium under its actuators.

    Attributes
    ----------
    geometry : Geometry
    at_points : array, (n_points, d)
        Displacements of all points of the elements in m, the nodes first.
    controls : dict of str to Control
        What is given of each actuator.
    amplitudes : dict of str to float
        Tension in N, or pressure in Pa, of each.
    state : Balanced
        Coefficients of the modes, and amplitudes.
    missed : float
        Largest distance in m of a place from its target; 0 without targets.
    """

    geometry: Geometry
    at_points: Array
    controls: dict[str, Control]
    amplitudes: dict[str, float]
    state: Balanced
    missed: float = 0.0

    def save(self, path: str | Path) -> None:
        """Write the displacement of the nodes to a file .npz, .vtu or .xdmf."""
        body, fields = self.geometry, {"displacement": self.displacement}
        write_solution(Path(path), body.coordinates, body.cells, body.cell_type, fields)

    @property
    def displacement(self) -> Array:
        """Displacements of the nodes in m, (n_nodes, d)."""
        return self.at_points[: len(self.geometry.coordinates)]

    @property
    def quantities(self) -> dict[str, float]:
        """Length in m, or volume in m³, of each actuator."""
        actuators, x = self.geometry.actuators, self.geometry.loaded_body.positions
        assert actuators is not None
        found = (unit.quantity(x + self.at_points) for unit in actuators.loads)
        return dict(zip(actuators.names, found, strict=True))

    @property
    def given(self) -> dict[str, float]:
        """What is given of each actuator, in the unit of its kind."""
        return {name: control.value for name, control in self.controls.items()}

    @property
    def largest(self) -> float:
        """Largest displacement of a node in m."""
        return float(np.linalg.norm(self.displacement, axis=1).max())

    def lines(self) -> list[str]:
        """Describe what is given and found of every actuator, in a line each."""
        actuators = self.geometry.actuators
        assert actuators is not None
        each = np.array([list(self.amplitudes.values()), list(self.quantities.values())]).T
        found = actuators.found(each)
        return [f"{name}: {each.written(self.geometry.units)}" for name, each in found.items()]


class Actuation:
    """Actuators of a body, forward and inverse, in modes.

    >>> model = Actuation.fit(Body.read("data/finger"))                      # doctest: +SKIP
    >>> tip = model.at({"left": 2.5}).displacement                           # doctest: +SKIP
    >>> model.reach({"tip": (0.01, 0.02, 0.1)}).given                        # doctest: +SKIP

    Parameters
    ----------
    body : Body
        With actuators.
    modes : array, (n_modes, n_points, d)
    sample : CellSample
    amplitudes : array, (n_states, n_actuators)
        Those of the states that the modes come from, in Pa or N.
    coefficients : array, (n_states, n_modes)
        Of these states.
    """

    def __init__(
        self, body: Body, modes: Array, sample: CellSample, amplitudes: Array, coefficients: Array
    ) -> None:
        self.body, self.sample, self.actuators = body, sample, actuators_of(body)
        self.reduced = ReducedBody(body.equilibrium, self.actuators.loads, modes, sample)
        self.amplitudes, self.coefficients = amplitudes, coefficients

    @classmethod
    def fit(
        cls,
        body: Body,
        loads: Sequence[str] = (),
        *,
        samples: int = SAMPLES,
        seed: int = SEED,
    ) -> Actuation:
        """Find modes of a body under its actuators.

        Parameters
        ----------
        body : Body
        loads : sequence of str
            Dead loads that may act as well, as ``--load`` has them: up to these, and as far the
            other way.
        samples : int
            Number of equilibria.
        seed : int
            Of the amplitudes.

        Raises
        ------
        InputError
            If the case has no actuators, or a number is wrong.
        WorkError
            If fewer than half of the equilibria are found.
        """
        if samples < 2:
            raise InputError(f"samples {samples}: expected 2 at least", "samples")
        actuators, series = actuators_of(body), Series(body)
        load = Load.of(body.geometry)
        following, first = load.following, len(body.geometry.surfaces)
        assert following is not None
        given = [Load.of(body.geometry, [text]).dead for text in loads]
        dead = np.array(given).reshape(len(given), *load.dead.shape)
        low, high = amplitude_limits(body)
        drawn = Halton(len(low) + len(dead), seed=seed).random(samples)
        amplitudes = low + (high - low) * ((1 + 2 * BEYOND) * drawn[:, : len(low)] - BEYOND)
        amplitudes = np.where(low >= 0, np.maximum(amplitudes, 0), amplitudes)  # cables
        forces = load.dead + np.tensordot(2 * drawn[:, len(low) :] - 1, dead, 1)
        states, kept = [], []
        title = "surrogate: equilibria under actuators"
        with closing(Progress(samples, 0, "states", title, passing=True)) as progress:
            for row, (values, force) in enumerate(zip(amplitudes, forces, strict=True)):
                whole = np.zeros((1, len(following.units)))
                whole[0, first : first + len(actuators)] = values
                state = _equilibrium(series, Load(force, replace(following, amplitudes=whole)))
                if state is not None:
                    states.append(state)
                    kept.append(row)
                progress.update(row + 1)
        if len(states) < max(2, samples // 2):
            raise WorkError(f"{len(states)} of {samples} equilibria under the actuators were found")
        fields = np.array(states)
        modes = modes_of(fields)
        flat = modes.reshape(len(modes), -1)
        coefficients = np.asarray(fields.reshape(len(fields), -1) @ np.linalg.pinv(flat))
        known = modes, coefficients, amplitudes[kept]
        sample = sampled_cells(body.equilibrium, actuators.loads, *known, seed)
        return cls(body, modes, sample, amplitudes[kept], coefficients)

    def save(self, path: Path) -> None:
        """Write what `read` reads."""
        arrays = {
            "modes": self.reduced.modes,
            "cells": self.sample.cells,
            "weights": self.sample.weights,
            "amplitudes": self.amplitudes,
            "coefficients": self.coefficients,
        }
        tensors = {name: torch.from_numpy(np.ascontiguousarray(a)) for name, a in arrays.items()}
        path.write_bytes(serialised(tensors))

    @classmethod
    def read(cls, path: Path, body: Body) -> Actuation:
        """Read a file for its body; InputError if it is damaged, or of another body."""
        tensors, _ = load_tensors(path)
        try:
            arrays = {name: tensor.numpy() for name, tensor in tensors.items()}
            sample = CellSample(arrays["cells"], arrays["weights"])
            modes, others = arrays["modes"], (arrays["amplitudes"], arrays["coefficients"])
            expected = body.equilibrium.free.shape
            if modes.shape[1:] != expected or others[0].shape[1] != len(actuators_of(body)):
                raise ValueError(f"modes of shape {modes.shape[1:]}, expected {expected}")
            return cls(body, modes, sample, *others)
        except (KeyError, ValueError) as error:
            raise InputError(f"{path}: no actuation of this body ({error})") from None

    @property
    def size(self) -> float:
        """Length of the body in m."""
        return float(np.ptp(self.body.geometry.coordinates, axis=0).max())

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the actuators."""
        return self.actuators.names

    def at(
        self, given: Given = (), load: str | Sequence[str] = (), start: ActuatedState | None = None
    ) -> ActuatedState:
        """Find the equilibrium under actuators.

        Parameters
        ----------
        given : mapping of str to float, or sequence of str
            What is given of actuators, by their names, in the unit of their kind, or as
            ``--actuate`` has it; others do nothing.
        load : str or sequence of str
            Dead load, as ``--load`` has it.
        start : ActuatedState, optional
            A state nearby.

        Raises
        ------
        InputError
            If there is no such actuator, or the load is wrong.
        WorkError
            If no equilibrium is found.
        """
        texts = [f"{k}={v}" for k, v in given.items()] if isinstance(given, Mapping) else given
        controls = self.actuators.given(texts)
        state = self.balanced(controls, self.work(load), None if start is None else start.state)
        return self._result(controls, state)

    def reach(
        self,
        places: Values,
        directions: Values | None = None,
        *,
        within: Mapping[str, tuple[float, float]] | None = None,
        load: str | Sequence[str] = (),
        effort: float = EFFORT,
        start: ActuatedState | None = None,
    ) -> ActuatedState:
        """Find what is to be given of the actuators to reach targets, or to come near to them.

        Parameters
        ----------
        places : mapping of str to sequence of d floats
            Where the mean of the nodes of a group, or the node next to X,Y[,Z], shall be, in m.
        directions : mapping of str to sequence of d floats, optional
            Where the surface of a group shall look: its mean outward normal.
        within : mapping of str to (low, high), optional
            Other limits of actuators than those of the case.
        load : str or sequence of str
            Dead load that acts as well.
        effort : float
            ε.
        start : ActuatedState, optional
            Where the search begins, under what the case gives of the actuators; at rest by default.

        Returns
        -------
        ActuatedState
            `ActuatedState.missed` says how far the places are from the targets.

        Raises
        ------
        InputError
            If a target, an actuator, a limit or the load is wrong.
        WorkError
            If no equilibrium is found where the search begins.
        """
        targets = targets_of(self.body.geometry, places, directions or {})
        search = Search(self, targets, self.limits(within or {}), self.work(load), effort)
        if start is None:
            values, state = search.found(None, None)
        else:
            before = np.array(list(start.given.values()))
            values, state = search.found(before, start.state)
        return replace(self._result(self.controls_of(values), state), missed=search.missed(state))

    def confirmed(self, found: ActuatedState, load: str | Sequence[str] = ()) -> ActuatedState:
        """The equilibrium of the finite elements under what is given; WorkError if none is."""
        body = self.body.equilibrium
        (force,) = body.forces_at_points(Load.of(self.body.geometry, load).dead[None])
        start = self.reduced.displacement(found.state.state).ravel(), found.state.amplitudes
        of = ActuatedBody(body, self.actuators.loads, force)
        controls = tuple(found.controls.values())
        state = balanced(of, controls, Balanced(*start), CONFIRMED)
        return replace(
            found,
            at_points=state.state.reshape(force.shape),
            amplitudes=dict(zip(self.names, state.amplitudes.tolist(), strict=True)),
        )

    def limits(self, within: Mapping[str, tuple[float, float]]) -> tuple[Array, Array]:
        """Limits of what is given, those of the case or others: (n_actuators,) each."""
        limits = np.array([actuator.limits for actuator in self.actuators.actuators])
        for name, (low, high) in within.items():
            if name not in self.names:
                known = ", ".join(self.names)
                raise InputError(f"within '{name}': no such actuator, expected one of {known}")
            if not (np.isfinite([low, high]).all() and low < high):
                raise InputError(f"within '{name}' = {low}:{high}: expected LOW:HIGH, LOW < HIGH")
            limits[self.names.index(name)] = low, high
        return limits[:, 0], limits[:, 1]

    def controls_of(self, values: Array) -> tuple[Control, ...]:
        """Controls of the case's kinds, of values (n_actuators,)."""
        return self.actuators.controls(values)

    def work(self, load: str | Sequence[str]) -> Array:
        """Works of a dead load on the modes, (n_modes,) in J."""
        dead = Load.of(self.body.geometry, load).dead[None]
        return self.reduced.works_of(self.body.equilibrium.forces_at_points(dead)[0])

    def balanced(
        self, controls: Sequence[Control], work: Array, start: Balanced | None
    ) -> Balanced:
        """The equilibrium in modes; WorkError if there is none."""
        measures = not all(control.gives_amplitude for control in controls)
        body = ActuatedModes(self.reduced, work, measures, self._tangent)
        if not measures:
            amplitudes = np.array([control.value for control in controls])
            first = self._first(amplitudes)
            if start is not None:
                first = start.state + first - self._first(start.amplitudes)
            start = Balanced(first, amplitudes)
        elif start is None:
            start = Balanced(np.zeros(self._modes), np.zeros(len(controls)))
        return balanced(body, controls, start, IN_MODES)

    def positions(self, state: Balanced) -> Array:
        """Positions of the nodes in m, (n_nodes, d)."""
        nodes = self.body.equilibrium.nodes
        return self.body.geometry.coordinates + self.reduced.displacement(state.state)[:nodes]

    def changes(self, values: Array, work: Array, state: Balanced) -> Array:
        """Derivatives of the displacement by what is given, (n_actuators, n_nodes, d)."""
        moved = moved_by(ActuatedModes(self.reduced, work), self.controls_of(values), state)
        return np.tensordot(moved, self.reduced.modes[:, : self.body.equilibrium.nodes], 1)

    def _first(self, amplitudes: Array) -> Array:
        """Coefficients of a first state under some amplitudes: (n_actuators,) → (n_modes,)."""
        return np.asarray(self._interpolation((amplitudes / self._unit)[None])[0, : self._modes])

    def _tangent(self, amplitudes: Array) -> Array:
        """The tangent of the internal forces there, (n_modes, n_modes) in J."""
        of_both = self._interpolation((amplitudes / self._unit)[None])[0, self._modes :]
        return np.asarray(of_both.reshape(self._modes, self._modes))

    @property
    def _modes(self) -> int:
        return len(self.reduced.modes)

    @cached_property
    def _unit(self) -> Array:
        return np.maximum(np.abs(self.amplitudes).max(axis=0), 1e-300)

    @cached_property
    def _interpolation(self) -> RBFInterpolator:
        m = self.amplitudes.shape[1]
        degree = 1 if len(self.amplitudes) > m + 1 else 0
        at = self.amplitudes / self._unit
        tangents = [self.reduced.tangent(q).ravel() for q in self.coefficients]
        both = np.concatenate([self.coefficients, tangents], axis=1)
        return RBFInterpolator(at, both, kernel="cubic", degree=degree, smoothing=1e-9)

    def _result(self, controls: Sequence[Control], state: Balanced) -> ActuatedState:
        return ActuatedState(
            self.body.geometry,
            self.reduced.displacement(state.state),
            dict(zip(self.names, controls, strict=True)),
            dict(zip(self.names, state.amplitudes.tolist(), strict=True)),
            state,
        )


def actuators_of(body: Body) -> PlacedActuators:
    """Actuators of a body; InputError if it has none."""
    if body.geometry.actuators is None:
        raise InputError("key 'actuators': the case of the body has none, expected some")
    return body.geometry.actuators


def amplitude_limits(body: Body) -> tuple[Array, Array]:
    """Smallest and largest amplitudes of the actuators of a case, (n_actuators,) each.

    Those of lengths, volumes and amounts of gas are found where each alone, or all together, are at
    a limit.

    Raises
    ------
    WorkError
        If there is no equilibrium under one actuator at a limit.
    """
    placed, equilibrium = actuators_of(body), body.equilibrium
    limits = np.array([actuator.limits for actuator in placed.actuators])
    gives = [control.gives_amplitude for control in placed.controls(limits[:, 0])]
    if all(gives):
        return limits[:, 0], limits[:, 1]
    force = np.zeros(equilibrium.free.shape)
    of, rest = ActuatedBody(equilibrium, placed.loads, force), np.zeros(len(placed))
    found = [rest]
    for number in np.flatnonzero(~np.array(gives)):
        for value in limits[number]:
            controls = list(placed.idle)
            controls[number] = placed.controls(np.full(len(placed), value))[number]
            start = Balanced(force.ravel(), rest)
            found.append(balanced(of, controls, start, IN_MODES).amplitudes)
    low, high = np.min(found, axis=0), np.max(found, axis=0)
    return np.where(gives, limits[:, 0], low), np.where(gives, limits[:, 1], high)


def _equilibrium(series: Series, load: Load) -> Array | None:
    """Displacements of all points in equilibrium, (n_points, d) in m; None if none is found."""
    body, equilibrium = series.body, series.body.equilibrium
    predicted = series.respond(load)[0]
    driven, descent = body.descend(load, predicted, Aim(ACCURACY))
    if descent.reached is False:
        try:
            driven = body.correct(load, predicted).displacement
        except WorkError:
            return None
    under = body.under(load.following)
    f = equilibrium.forces_at_points(load.dead[None])
    return np.asarray(under.at_points(driven[None], f)[0])
