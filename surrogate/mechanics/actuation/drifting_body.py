r"""A body in modes that is stiffer or softer than its model, under loads of unknown size.

It is :math:`e^φ` times as stiff, and loads f with factors w act on it beside those that always do.
The equilibrium of a body whose elements are all stiffer is that of the model under smaller loads,

.. math:: q = q\big(e^{-φ} a, \; e^{-φ} (f_0 + \sum_j w_j f_j)\big)

with tensions and pressures a; lengths and volumes that are given stay. The derivatives by them, φ
and w are those of `followed`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from shared_schema.actuators import Control
from shared_schema.common.errors import InputError
from surrogate.mechanics.actuation.actuated_body import ActuatedModes
from surrogate.mechanics.actuation.actuation import IN_MODES, Actuation
from surrogate.mechanics.actuation.bordered import Balanced, balanced, followed

Array = NDArray[np.float64]
SOME = 16  # sampled states
LONG = 0.05  # of the sampled states: a step of Newton's method after which more follow
FREED = 1e-3  # of their work: that of a lack of balance after which they do, too


class DriftingBody:
    """Equilibria, and their derivatives.

    Parameters
    ----------
    actuation : Actuation
    loads : sequence of str
        Of factor 1, as ``--load`` has them.

    Raises
    ------
    InputError
        If a load is wrong, or an amount of gas is given of an actuator.
    """

    def __init__(self, actuation: Actuation, loads: Sequence[str]) -> None:
        self._of, self._controls = actuation, actuation.controls_of(np.zeros(len(actuation.names)))
        if any(control.kind == "gas" for control in self._controls):
            raise InputError("actuators: an amount of gas is given, expected pressures or volumes")
        always = actuation.work(())
        each = [actuation.work([text]) - always for text in loads]
        self._works = np.array([always, *each])
        states, internal = actuation.coefficients, actuation.reduced.internal
        self._usual = float(np.sqrt(np.square(states).sum(axis=1).mean()))
        works = [float(f @ q) for q in states[:SOME] if (f := internal(q)) is not None]
        self._work = float(np.mean(works))
        self._scales = np.array([control.gives_amplitude for control in self._controls])

    def at(self, values: Array, parameters: Array) -> Balanced:
        """The equilibrium in modes, from rest; WorkError if there is none.

        Parameters
        ----------
        values : array, (n_actuators,)
            What is given, in the unit of each kind.
        parameters : array, (1 + n_loads,)
            φ and w.
        """
        body, controls = self._under(values, parameters)
        rest = Balanced(np.zeros(len(self._of.reduced.modes)), np.zeros(len(controls)))
        return balanced(body, controls, rest)

    def followed(
        self, values: Array, parameters: Array, near: Balanced
    ) -> tuple[Balanced, Array, Array]:
        """The equilibrium close to a state, to one step of Newton's method, and its derivatives.

        More of them follow a long step, and one that frees energy: a state that has been turned
        along a straight line is stretched, and its tangent too stiff.

        Returns
        -------
        Balanced
        array, (n_actuators, n_modes) and array, (1 + n_loads, n_modes)
            Derivatives of the modes by what is given, and by φ and w.

        Raises
        ------
        WorkError
            If there is no equilibrium.
        """
        body, controls = self._under(values, parameters)
        state, freed, moved = followed(body, controls, near, self._works)
        is_long = np.linalg.norm(state.state - near.state) > LONG * self._usual
        if is_long or freed > FREED * self._work:
            state = balanced(body, controls, near, IN_MODES)
            state, _, moved = followed(body, controls, state, self._works)
        softer, count = np.exp(-parameters[0]), len(values)
        by_given = moved[:count] * np.where(self._scales, softer, 1.0)[:, None]
        by_force = softer * moved[count:]
        by_stiffness = (self._scales * values) @ by_given + _factors(parameters) @ by_force
        return state, by_given, np.concatenate([-by_stiffness[None], by_force[1:]])

    def ahead(self, values: Array, parameters: Array, last: Balanced, change: Array) -> Balanced:
        """Nearly the equilibrium, from the last one and its change if the body were linear.

        Polynomials of the amplitudes tell what that change misses.
        """
        if not self._scales.all():
            return last._replace(state=last.state + change)
        after = np.exp(-parameters[0]) * values
        return Balanced(last.state + change + self._of.nearby.curved(last.amplitudes, after), after)

    def _under(self, values: Array, parameters: Array) -> tuple[ActuatedModes, tuple[Control, ...]]:
        """What does to the model what acts on the body."""
        softer = float(np.exp(-parameters[0]))
        scaled = np.where(self._scales, softer * values, values)
        each = zip(self._controls, scaled, strict=True)
        controls = tuple(replace(control, value=float(value)) for control, value in each)
        work = softer * _factors(parameters) @ self._works
        return ActuatedModes(self._of.reduced, work, not self._scales.all()), controls


def _factors(parameters: Array) -> Array:
    return np.append(1.0, parameters[1:])
