"""Where actuators lead a body, nearly: polynomials of the amplitudes, from which searches start.

They are of the equilibria in modes under sampled amplitudes, their derivatives, and the tangents
there (`surrogate.mechanics.actuation.response_surface`). Beyond the sampled amplitudes they stay.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.stats.qmc import Halton

from shared_schema.actuators import pressed
from shared_schema.common.errors import WorkError
from surrogate.mechanics.actuation.actuated_body import ActuatedModes
from surrogate.mechanics.actuation.bordered import Balanced, newton
from surrogate.mechanics.actuation.response_surface import ResponseSurface, points_of
from surrogate.mechanics.equilibrium.halved_steps import halved_steps

Array = NDArray[np.float64]
IN_BALANCE = 1e-7  # of the last step of Newton's method
DEGREE = 3  # of the polynomials of tangents


@dataclass(frozen=True)
class NearbyStates:
    """Polynomials of amplitudes a in Pa or N, (n_actuators,).

    Attributes
    ----------
    box : array, (2, n_actuators)
        Smallest and largest amplitudes that they are fitted to.
    states : ResponseSurface
        Coefficients of the modes, of the amplitudes over the largest ones.
    tangents : ResponseSurface
        Upper halves of the tangents of the internal forces there, in J.
    """

    box: Array
    states: ResponseSurface
    tangents: ResponseSurface

    @classmethod
    def fit(cls, body: ActuatedModes, coefficients: Array, amplitudes: Array) -> NearbyStates:
        """Fit them to states of a body.

        Parameters
        ----------
        body : ActuatedModes
            Under the dead load of the case.
        coefficients : array, (n_states, n_modes)
            Of states under any dead load.
        amplitudes : array, (n_states, n_actuators)
            Under which they are.

        Raises
        ------
        WorkError
            If fewer than two of them are left without what holds them beside the body's load.
        """
        box = np.array([amplitudes.min(axis=0), amplitudes.max(axis=0)])
        at, states, slopes, unit = [], [], [], _largest(box)
        for q, a in zip(coefficients, amplitudes, strict=True):
            try:
                state = _unloaded(body, Balanced(q, a))
            except WorkError:
                continue
            k = body.body.tangent(state) - body.body.following_slopes(state, a)
            at.append(a / unit)
            states.append(state)
            slopes.append(unit[:, None] * np.linalg.solve(k, body.body.following(state).T).T)
        if len(at) < 2:
            raise WorkError("no equilibria in modes, expected some")
        surface = ResponseSurface.fit(np.array(at), np.array(states), np.array(slopes))
        (low, high), count = box / unit, points_of(len(unit), DEGREE)
        places = low + (high - low) * Halton(len(unit), seed=0).random(count)
        upper = np.triu_indices(coefficients.shape[1])
        tangents = np.array([body.body.tangent(surface.at(place))[upper] for place in places])
        return cls(box, surface, ResponseSurface.fit(places, tangents, highest=DEGREE))

    def state(self, amplitudes: Array) -> Array:
        """Coefficients of the modes, (n_modes,)."""
        return self.states.at(self._inside(amplitudes))

    def slopes(self, amplitudes: Array) -> Array:
        """Their derivatives by the amplitudes, (n_actuators, n_modes)."""
        return self.states.slopes(self._inside(amplitudes)) / _largest(self.box)[:, None]

    def curved(self, before: Array, after: Array) -> Array:
        """What slopes at some amplitudes miss of the change of the state to others, (n_modes,)."""
        start, end = self._inside(before), self._inside(after)
        along = (end - start) @ self.states.slopes(start)
        return self.states.at(end) - self.states.at(start) - along

    def tangent(self, amplitudes: Array) -> Array:
        """The tangent of the internal forces, (n_modes, n_modes) in J."""
        size = self.states.coefficients.shape[1]
        whole = np.zeros((size, size))
        whole[np.triu_indices(size)] = self.tangents.at(self._inside(amplitudes))
        return whole + np.triu(whole, 1).T

    def _inside(self, amplitudes: Array) -> Array:
        """Variables of the polynomials, (n_actuators,)."""
        return np.asarray(np.clip(amplitudes, *self.box) / _largest(self.box))


def _largest(box: Array) -> Array:
    """Largest sizes of amplitudes, (n_actuators,)."""
    return np.asarray(np.maximum(np.abs(box).max(axis=0), 1e-300))


def _unloaded(body: ActuatedModes, start: Balanced) -> Array:
    """Take away what holds a state beside the body's load; WorkError where none is left."""
    residual, controls = body.residual(*start), pressed(start.amplitudes)
    if residual is None:
        raise WorkError("a cell is inverted")

    def go(share: float, last: Balanced) -> Balanced:
        held = replace(body, work=body.work + (1 - share) * residual.forces)
        found = newton(held, controls, 1.0, last, IN_BALANCE)
        if found is None:
            raise WorkError("no equilibrium")
        return found

    return halved_steps(go, start, "no equilibrium in modes beyond {:.0%}").state
