r"""A loop that leads places of a body to targets: markers in, actuations out, frame by frame.

A frame sees markers of a body that rests under the last actuations v. It differs from its model by
parameters that drift: its stiffness, and loads of unknown size
(`surrogate.mechanics.actuation.drifting_body`); what these do not explain moves it by modes Φ with
coefficients δ:

.. math:: u = Φ \, \big(q(v; φ, w) + δ\big)

Markers tell the parameters (`surrogate.mechanics.actuation.seen_state`). Around the frame, the body
is linear, and the next actuations are those that lead nearest to the target with the least effort
(`surrogate.mechanics.actuation.targets`), within their limits, and their rates times the period. A
place that markers tell is led to its target without an offset.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shared_schema.common.arguments import checked_arguments, real_numbers
from shared_schema.common.errors import InputError, WorkError
from surrogate.mechanics.actuation.actuation import EFFORT, Actuation
from surrogate.mechanics.actuation.drifting_body import DriftingBody
from surrogate.mechanics.actuation.seen_state import Estimate
from surrogate.mechanics.actuation.targets import REACHED, SETTLED, Effort, targets_of
from surrogate.mechanics.identification.markers import Markers

Array = NDArray[np.float64]
PERIOD, DRIFT = 0.01, 0.5  # s
NOISE = 5e-4  # of the size of the body
STIFFNESS, MOST = 0.3, 1.5  # deviation of φ, and its largest size
BESIDE = 0.1  # deviation of δ, of the coefficients of the sampled states
FARTHEST = 1.0  # of the size of the body: a marker that far from where it is expected is wrong


@dataclass(frozen=True)
class ControlFrame:
    """What is given next, and what is known of the body before.

    Attributes
    ----------
    given : dict of str to float
        Of each actuator, in the unit of its kind.
    displacement : array, (n_nodes, d)
        In m.
    places : array, (n_targets, d)
        Where the places of the targets are, in m.
    missed : float
        Largest distance in m of one from its target, before the actuations are given.
    stiffness : float
        That of the body over that of its model, :math:`e^φ`.
    loads : tuple of float
        Factors w on the unknown loads.
    unseen : int
        Number of markers that are not seen.
    warning : str
        Why the last actuations stay, or that the target is out of reach: the body, if it were
        linear, would not come half as near within all limits. Else empty.
    """

    given: dict[str, float]
    displacement: Array
    places: Array
    missed: float
    stiffness: float
    loads: tuple[float, ...]
    unseen: int
    warning: str = ""


class Controller:
    """Leads places of a body to targets, whatever it differs by from its model.

    >>> controller = Controller(model, markers=at_rest, target="tip")        # doctest: +SKIP
    >>> frame = controller.step(seen, (0.01, 0.02, 0.1))                     # doctest: +SKIP
    >>> frame.given                                                          # doctest: +SKIP

    Parameters
    ----------
    actuation : Actuation
        Its modes should know the loads (`Actuation.fit`).
    markers : array, (m, d)
        Places at rest in m, in or on the body, of what is measured.
    target : str or sequence of str
        Groups whose mean place is led, or places X,Y[,Z] of nodes.
    loads : sequence of str
        Loads of unknown size, as ``--load`` has them, of the size that is usual: "tip:0,0,-0.1".
    within : mapping of str to (low, high), optional
        Other limits of actuators than those of the case.
    rates : mapping of str to float, optional
        Largest changes per second of what is given; by default, from one limit to the other.
    period : float
        Time between two frames in s.
    noise : float, optional
        Standard deviation of a component of a marker in m; 5 · 10⁻⁴ of the body's size by default.
    drift : float
        Time in s in which the body changes, and what acts on it.
    effort : float
        ε of `surrogate.mechanics.actuation.targets`.

    Attributes
    ----------
    targets : tuple of str
        Places that are led, in the order of their points.

    Raises
    ------
    InputError
        If an argument is wrong, or an amount of gas is given of an actuator.
    """

    @checked_arguments
    def __init__(
        self,
        actuation: Actuation,
        *,
        markers: ArrayLike,
        target: str | Sequence[str],
        loads: Sequence[str] = (),
        within: Mapping[str, tuple[float, float]] | None = None,
        rates: Mapping[str, float] | None = None,
        period: float = PERIOD,
        noise: float | None = None,
        drift: float = DRIFT,
        effort: float = EFFORT,
    ) -> None:
        noise = NOISE * actuation.size if noise is None else noise
        for name, value in {"period": period, "noise": noise, "drift": drift}.items():
            if not 0 < value < np.inf:
                raise InputError(f"{name} {value}: expected a number above 0", name)
        geometry, at_rest = actuation.body.geometry, real_numbers(markers, "markers")
        self._of, self._body = actuation, DriftingBody(actuation, loads)
        self._noise, self._part = noise, period / drift
        self._low, self._high = actuation.limits(within or {})
        rest = np.array([control.at_rest for control in actuation.controls_of(self._low)])
        unit = np.maximum(np.abs(self._high - rest), np.abs(self._low - rest))
        self._effort = Effort(unit, rest, effort * actuation.size)
        self._most = period * self._fastest(rates or {})
        self.targets = (target,) if isinstance(target, str) else tuple(target)
        anywhere = dict.fromkeys(self.targets, (0.0,) * geometry.dimension)
        self._targets = targets_of(geometry, anywhere, {})
        seen = Markers.of(at_rest, at_rest)
        self._at_rest, at_markers = seen.at_rest, seen.interpolation(geometry)
        self._modes = actuation.reduced.modes[:, : len(geometry.coordinates)]
        self._at_markers = np.array([at_markers @ mode for mode in self._modes])
        beside = BESIDE * np.sqrt(np.square(actuation.coefficients).mean(axis=0))
        self._known = Estimate.of(np.concatenate([[STIFFNESS], np.ones(len(loads)), beside]))
        self._values = np.clip(rest, self._low, self._high)
        self._last = self._next = self._body.at(self._values, self._parameters)
        self._at = self._last.state

    @property
    def given(self) -> dict[str, float]:
        """What is given of each actuator now, in the unit of its kind."""
        return dict(zip(self._of.names, self._values.tolist(), strict=True))

    @checked_arguments
    def step(self, measured: ArrayLike | None, target: ArrayLike) -> ControlFrame:
        """Find the next actuations.

        Parameters
        ----------
        measured : array, (m, d), or None
            Where the markers are in m; NaN of those that are not seen, None if none is.
        target : array, (d,) or (n_targets, d)
            Where the places shall be in m.

        Returns
        -------
        ControlFrame
            With the last actuations if no marker is seen, or the model has no equilibrium.

        Raises
        ------
        InputError
            If a shape is wrong, or a target is not finite.
        """
        shape, aims = (len(self._targets), self._at_rest.shape[1]), real_numbers(target, "target")
        if aims.size != np.prod(shape) or not np.isfinite(aims).all():
            raise InputError(f"target: expected {shape} finite numbers in m")
        aims, seen = aims.reshape(shape), self._seen(measured)
        there = np.asarray(np.isfinite(seen).all(axis=1))
        unseen = int((~there).sum())
        self._known = self._known.later(self._part)
        if not there.any():
            return self._frame(aims, unseen, "no marker is seen: the last actuations stay")
        given = self._values, self._parameters
        try:
            self._last, by_given, by_parameters = self._body.followed(*given, self._next)
        except WorkError:
            self._known = replace(self._known, values=self._known.values / 2)
            self._next = self._last
            said = "the model has no equilibrium: the last actuations stay"
            return self._frame(aims, unseen, said)
        change = self._learned(seen, there, by_parameters)
        frame = self._frame(aims, unseen)
        x, unit = self._of.body.geometry.coordinates + frame.displacement, self._effort.unit
        changes = np.tensordot(by_given * unit[:, None], self._modes, 1)
        slopes = np.concatenate([each.slopes(x, changes) for each in self._targets])
        low = np.maximum(self._low, self._values - self._most)
        high = np.minimum(self._high, self._values + self._most)
        left = (frame.places - aims).ravel()
        step = self._effort.step(slopes, left, self._values, low, high)
        far = frame.missed > REACHED * self._of.size
        stays = bool((np.abs(step) <= SETTLED * unit).all())
        beyond = far and (stays or self._is_beyond(slopes, left))
        self._values = np.clip(self._values + step, low, high)
        moved = change @ by_parameters + step @ by_given
        self._next = self._body.ahead(self._values, self._parameters, self._last, moved)
        said = "the target is out of reach of the actuators" if beyond else ""
        return replace(frame, given=self.given, warning=said)

    @property
    def _parameters(self) -> Array:
        """φ and w."""
        return self._known.values[: -len(self._modes)]

    def _learned(self, seen: Array, there: NDArray[np.bool_], by_parameters: Array) -> Array:
        """Take in where the markers are, (m, d) in m: changes of φ and w."""
        before = self._known.values
        of_modes = np.concatenate([by_parameters, np.eye(len(self._modes))])
        at = self._last.state + before[-len(self._modes) :]
        expected = self._at_rest + np.tensordot(at, self._at_markers, 1)
        left = (seen - expected)[there].ravel()
        slopes = np.tensordot(of_modes, self._at_markers[:, there], 1)
        known = self._known.seen(slopes.reshape(len(of_modes), -1).T, left, self._noise)
        known.values[0] = np.clip(known.values[0], -MOST, MOST)
        self._known = known
        change = known.values - before
        self._at = at + change @ of_modes
        return change[: len(by_parameters)]

    def _is_beyond(self, slopes: Array, left: Array) -> bool:
        """Whether the body, if it were linear, would not come half as near in any time."""
        step = self._effort.step(slopes, left, self._values, self._low, self._high)
        nearest = left + slopes @ (step / self._effort.unit)
        far, near = (
            np.linalg.norm(each.reshape(len(self._targets), -1), axis=1).max()
            for each in (left, nearest)
        )
        return bool(near > max(far / 2, REACHED * self._of.size))

    def _frame(self, aims: Array, unseen: int, warning: str = "") -> ControlFrame:
        displacement = np.tensordot(self._at, self._modes, 1)
        x = self._of.body.geometry.coordinates + displacement
        places = np.array([target.reached(x) for target in self._targets])
        missed = float(np.linalg.norm(places - aims, axis=1).max())
        stiffness, loads = float(np.exp(self._parameters[0])), tuple(self._parameters[1:].tolist())
        known = displacement, places, missed, stiffness, loads
        return ControlFrame(self.given, *known, unseen, warning)

    def _seen(self, measured: ArrayLike | None) -> Array:
        """Where markers are in m, (m, d); NaN of those that are not seen, or cannot be there."""
        if measured is None:
            return np.full(self._at_rest.shape, np.nan)
        seen = real_numbers(measured, "measured")
        if seen.shape != self._at_rest.shape:
            said = f"measured has shape {seen.shape}, expected {self._at_rest.shape}"
            raise InputError(said, "measured")
        expected = self._at_rest + np.tensordot(self._at, self._at_markers, 1)
        far = ~(np.linalg.norm(seen - expected, axis=1) <= FARTHEST * self._of.size)
        return np.where(far[:, None], np.nan, seen)

    def _fastest(self, rates: Mapping[str, float]) -> Array:
        """Largest changes per second, (n_actuators,)."""
        found = self._high - self._low
        for name, rate in rates.items():
            if name not in self._of.names or not 0 < rate < np.inf:
                known = ", ".join(self._of.names)
                raise InputError(f"rates '{name}' = {rate}: expected one of {known}, above 0")
            found[self._of.names.index(name)] = rate
        return found
