r"""What actuators do to a body, in milliseconds: equilibria in modes of its displacement.

The displacement under actuators is nearly that of a few modes, those of equilibria under random
amplitudes (`Actuation.fit`). The equilibrium in these modes
(`surrogate.mechanics.actuation.reduced_body`) takes any tensions, lengths, pressures, volumes and
amounts of gas, and dead loads that the modes know. It starts from polynomials of the amplitudes
(`surrogate.mechanics.actuation.nearby_states`). With the tangent of an equilibrium nearby, Newton's
method goes further than with that of the state, where slender bodies are stretched by what is wrong
with it (Magisano, Leonetti and Garcea 2017).
"""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from shared_schema.actuators import Control
from shared_schema.common.errors import InputError
from shared_schema.common.files import require_writable
from shared_schema.common.solution_file import write_solution
from surrogate.mechanics.actuation.actuated_body import ActuatedBody, ActuatedModes
from surrogate.mechanics.actuation.bordered import Balanced, balanced, moved_by
from surrogate.mechanics.actuation.nearby_states import NearbyStates
from surrogate.mechanics.actuation.reduced_body import (
    CellSample,
    ReducedBody,
    modes_of,
    sampled_cells,
)
from surrogate.mechanics.actuation.response_surface import ResponseSurface
from surrogate.mechanics.actuation.sampled_states import (
    actuators_of,
    sampled_states,
    with_amplitudes,
)
from surrogate.mechanics.actuation.targets import Search, Values, targets_of
from surrogate.mechanics.body.geometry import Geometry
from surrogate.mechanics.certify.full_certificate import Certificate
from surrogate.mechanics.statics.body import Body
from surrogate.mechanics.statics.load import Load
from surrogate.runtime.tensor_file import load_tensors, serialised

logger = logging.getLogger(__name__)
Array = NDArray[np.float64]
KEPT = "actuation.safetensors"  # file of the modes, in the folder of a body or a run
SAMPLES, SEED = 128, 0
CONFIRMED = 1e-8  # of that of the finite elements
EFFORT = 1e-3  # ε of `surrogate.mechanics.actuation.targets`
IN_MODES = 1e-3  # of the last step of Newton's method there
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
    coefficients : array, (n_states, n_modes)
        Of the states that the modes come from.
    nearby : NearbyStates
    asked : int
        Number of equilibria that were asked for.
    """

    def __init__(
        self,
        body: Body,
        modes: Array,
        sample: CellSample,
        coefficients: Array,
        nearby: NearbyStates,
        asked: int = 0,
    ) -> None:
        self.body, self.sample, self.actuators = body, sample, actuators_of(body)
        self.reduced = ReducedBody(body.equilibrium, self.actuators.loads, modes, sample)
        self.coefficients, self.nearby, self.asked = coefficients, nearby, asked

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
        fields, amplitudes = sampled_states(body, loads, samples, seed)
        units, modes = actuators_of(body).loads, modes_of(fields)
        flat = modes.reshape(len(modes), -1)
        coefficients = np.asarray(fields.reshape(len(fields), -1) @ np.linalg.pinv(flat))
        sample = sampled_cells(body.equilibrium, units, modes, coefficients, amplitudes, seed)
        reduced = ReducedBody(body.equilibrium, units, modes, sample)
        (dead,) = body.equilibrium.forces_at_points(Load.of(body.geometry).dead[None])
        in_modes = ActuatedModes(reduced, reduced.works_of(dead), measures=False)
        nearby = NearbyStates.fit(in_modes, coefficients, amplitudes)
        return cls(body, modes, sample, coefficients, nearby, samples)

    @classmethod
    def of_folder(
        cls,
        folder: str | Path,
        body: Body,
        loads: Sequence[str] = (),
        *,
        samples: int | None = None,
        file: Path | None = None,
    ) -> Actuation:
        """Read the modes that are kept in the folder of a body, or make and keep them, as `fit`.

        Parameters
        ----------
        folder : str or Path
            Of the body, or of a run.
        body : Body
        loads : sequence of str
        samples : int, optional
            Number of equilibria, of `fit` by default. New modes are made if those that are kept are
            of fewer.
        file : Path, optional
            Where the modes are kept; by default ``actuation.safetensors`` in the folder.
        """
        path = file or Path(folder) / KEPT
        if path.is_file() and (samples is None or samples <= cls._asked(path)):
            return cls.read(path, body)
        require_writable(path)
        count = samples or SAMPLES
        told = "%s: modes of %d equilibria are made, once (--samples N of surrogate actuate: of N)"
        logger.info(told, path, count)
        model = cls.fit(body, loads, samples=count)
        model.save(path)
        logger.info("%s: %d modes", path, len(model.reduced.modes))
        return model

    @staticmethod
    def _asked(path: Path) -> int:
        """Number of equilibria that the modes in a file were asked for; 0 of earlier versions."""
        tensors, _ = load_tensors(path)
        return int(tensors["asked"][0]) if "asked" in tensors else 0

    def save(self, path: str | Path) -> None:
        """Write what `read` reads."""
        arrays = {
            "modes": self.reduced.modes,
            "cells": self.sample.cells,
            "weights": self.sample.weights,
            "box": self.nearby.box,
            "coefficients": self.coefficients,
            "states": self.nearby.states.coefficients,
            "tangents": self.nearby.tangents.coefficients,
            "asked": np.array([self.asked]),
        }
        tensors = {name: torch.from_numpy(np.ascontiguousarray(a)) for name, a in arrays.items()}
        Path(path).write_bytes(serialised(tensors))

    @classmethod
    def read(cls, path: str | Path, body: Body) -> Actuation:
        """Read a file for its body; InputError if it is damaged, or of another body."""
        tensors, _ = load_tensors(Path(path))
        try:
            arrays = {name: tensor.numpy() for name, tensor in tensors.items()}
            sample = CellSample(arrays["cells"], arrays["weights"])
            modes, box, expected = arrays["modes"], arrays["box"], body.equilibrium.free.shape
            if modes.shape[1:] != expected or box.shape != (2, len(actuators_of(body))):
                raise ValueError(f"modes of shape {modes.shape[1:]}, expected {expected}")
            both = (ResponseSurface(box.shape[1], arrays[key]) for key in ("states", "tangents"))
            states, asked = arrays["coefficients"], int(arrays.get("asked", [0])[0])
            return cls(body, modes, sample, states, NearbyStates(box, *both), asked)
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
        self._warn_of(controls)
        state = self.balanced(controls, self.work(load), None if start is None else start.state)
        return self._result(controls, state)

    def _warn_of(self, controls: Sequence[Control]) -> None:
        """Log a warning for what is given beyond the limits of the case."""
        every = self.names, self.actuators.actuators, controls, self.actuators.idle
        for name, actuator, control, idle in zip(*every, strict=True):
            low, high = actuator.limits
            if (
                control != idle
                and control.kind == actuator.kind
                and not (low <= control.value <= high)
            ):
                said = "%s = %g: the limits of the case, for which the modes are, are %g and %g"
                logger.warning(said, name, control.value, low, high)

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

    def certify(self, found: ActuatedState, load: str | Sequence[str] = ()) -> Certificate:
        """Estimate the error of a state under its tensions and pressures, as `Body.certify`."""
        geometry, amplitudes = self.body.geometry, np.array(list(found.amplitudes.values()))
        acting = with_amplitudes(geometry, Load.of(geometry, load), amplitudes)
        return self.body.certify(acting, found.displacement)

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
        first = self.near(controls)
        body = ActuatedModes(self.reduced, work, first is None, self.nearby.tangent)
        if first is None:
            at_rest = Balanced(np.zeros(len(self.reduced.modes)), np.zeros(len(controls)))
            first = at_rest if start is None else start
        elif start is not None:
            state = start.state + first.state - self.nearby.state(start.amplitudes)
            first = first._replace(state=state)
        return balanced(body, controls, first, IN_MODES)

    def near(self, controls: Sequence[Control]) -> Balanced | None:
        """The state that polynomials tell, where tensions and pressures are given."""
        if not all(control.gives_amplitude for control in controls):
            return None
        amplitudes = np.array([control.value for control in controls])
        return Balanced(self.nearby.state(amplitudes), amplitudes)

    def changes(self, controls: Sequence[Control], state: Balanced, work: Array) -> Array:
        """Derivatives of a state by what is given, (n_actuators, n_modes)."""
        return moved_by(ActuatedModes(self.reduced, work), controls, state)

    def changes_near(self, controls: Sequence[Control], state: Balanced, work: Array) -> Array:
        """Nearly these, of the polynomials where they tell them."""
        if not all(control.gives_amplitude for control in controls):
            return self.changes(controls, state, work)
        return self.nearby.slopes(state.amplitudes)

    def _result(self, controls: Sequence[Control], state: Balanced) -> ActuatedState:
        return ActuatedState(
            self.body.geometry,
            self.reduced.displacement(state.state),
            dict(zip(self.names, controls, strict=True)),
            dict(zip(self.names, state.amplitudes.tolist(), strict=True)),
            state,
        )
