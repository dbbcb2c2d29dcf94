r"""A body in modes that is stiffer or softer than its model, under loads of unknown size.

It is :math:`e^φ` times as stiff, and loads f with factors w act on it beside those that always do.
The equilibrium of a body whose elements are all stiffer is that of the model under smaller loads,

.. math:: q = q\big(e^{-φ} a, \; e^{-φ} (f_0 + \sum_j w_j f_j)\big)

with tensions and pressures a; lengths and volumes that are given stay. The derivatives by them, φ
and w are those of `moved_by`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from shared_schema.actuators import Control
from shared_schema.common.errors import InputError
from surrogate.mechanics.actuation.actuated_body import ActuatedModes
from surrogate.mechanics.actuation.actuation import Actuation
from surrogate.mechanics.actuation.bordered import Balanced, moved_by

Array = NDArray[np.float64]


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
        self._scales = np.array([control.gives_amplitude for control in self._controls])

    def balanced(self, values: Array, parameters: Array, start: Balanced | None) -> Balanced:
        """The equilibrium in modes; WorkError if there is none.

        Parameters
        ----------
        values : array, (n_actuators,)
            What is given, in the unit of each kind.
        parameters : array, (1 + n_loads,)
            φ and w.
        start : Balanced or None
            An equilibrium nearby.
        """
        return self._of.balanced(*self._under(values, parameters), start)

    def slopes(self, values: Array, parameters: Array, state: Balanced) -> tuple[Array, Array]:
        """Derivatives of modes by what is given, and by φ and w.

        Returns
        -------
        array, (n_actuators, n_modes) and array, (1 + n_loads, n_modes)
        """
        controls, work = self._under(values, parameters)
        body = ActuatedModes(self._of.reduced, work, not self._scales.all())
        moved = moved_by(body, controls, state, self._works)
        softer, count = np.exp(-parameters[0]), len(values)
        by_given = moved[:count] * np.where(self._scales, softer, 1.0)[:, None]
        by_force = softer * moved[count:]
        by_stiffness = (self._scales * values) @ by_given + self._factors(parameters) @ by_force
        return by_given, np.concatenate([-by_stiffness[None], by_force[1:]])

    def _under(self, values: Array, parameters: Array) -> tuple[tuple[Control, ...], Array]:
        """Controls, and the work of dead loads in J, that do to the model what acts on the body."""
        softer = float(np.exp(-parameters[0]))
        scaled = np.where(self._scales, softer * values, values)
        each = zip(self._controls, scaled, strict=True)
        controls = tuple(replace(control, value=float(value)) for control, value in each)
        return controls, softer * self._factors(parameters) @ self._works

    def _factors(self, parameters: Array) -> Array:
        return np.append(1.0, parameters[1:])
