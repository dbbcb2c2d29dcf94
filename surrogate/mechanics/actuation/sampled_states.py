"""Equilibria of a body under random amplitudes of its actuators, from which its modes come."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import closing
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.stats.qmc import Halton

from shared_schema.actuators import PlacedActuators
from shared_schema.common.errors import InputError, WorkError
from shared_schema.common.progress import Progress
from surrogate.mechanics.actuation.actuated_body import ActuatedBody
from surrogate.mechanics.actuation.bordered import Balanced, balanced
from surrogate.mechanics.body.geometry import Geometry
from surrogate.mechanics.descent.aim import Aim
from surrogate.mechanics.statics.body import Body
from surrogate.mechanics.statics.load import Load
from surrogate.mechanics.statics.prediction import Series

Array = NDArray[np.float64]
BEYOND = 0.05  # of the limits, to either side, that samples go
ACCURACY = 1e-4  # of the sampled equilibria
SETTLED = 1e-4  # of the last step of Newton's method at a limit


def sampled_states(
    body: Body, loads: Sequence[str], samples: int, seed: int
) -> tuple[Array, Array]:
    """Find equilibria under random amplitudes and loads.

    Returns
    -------
    fields : array, (n_states, n_points, d)
        Displacements in m.
    amplitudes : array, (n_states, n_actuators)
        In Pa or N.

    Raises
    ------
    InputError
        If the case has no actuators, or a number is wrong.
    WorkError
        If fewer than half of the equilibria are found.
    """
    if samples < 2:
        raise InputError(f"samples {samples}: expected 2 at least", "samples")
    actuators_of(body)  # refuses a body without any
    series, load = Series(body), Load.of(body.geometry)
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
            acting = with_amplitudes(body.geometry, replace(load, dead=force), values)
            state = _equilibrium(series, acting)
            if state is not None:
                states.append(state)
                kept.append(row)
            progress.update(row + 1)
    if len(states) < max(2, samples // 2):
        raise WorkError(f"{len(states)} of {samples} equilibria under the actuators were found")
    return np.array(states), amplitudes[kept]


def with_amplitudes(geometry: Geometry, load: Load, amplitudes: Array) -> Load:
    """A load under amplitudes of the actuators, (n_actuators,), but no pressures of surfaces."""
    assert load.following is not None  # of a body with actuators
    whole = np.concatenate([np.zeros(len(geometry.surfaces)), amplitudes])
    return replace(load, following=replace(load.following, amplitudes=whole[None]))


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
            found.append(balanced(of, controls, start, SETTLED).amplitudes)
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
