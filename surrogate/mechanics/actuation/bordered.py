r"""Equilibria whose loads follow from lengths, volumes and amounts of gas that are given.

Displacements and amplitudes solve

.. math:: R(u) - \sum_i a_i \, g_i(u) = 0, \qquad h_i(a_i, q_i(u)) = 0

with the equation h of what is given of an actuator (`shared_schema.actuators.control`) and the
quantity q that its amplitude works on, :math:`∂q_i / ∂u = ± g_i`. A step of Newton's method is that
of the displacement under fixed amplitudes, and the responses to the units beside it:

.. math:: δu = K^{-1} (-r + G \, δa), \qquad
   \Big(\frac{∂h}{∂q} (± G)^T K^{-1} G + \frac{∂h}{∂a}\Big) δa
   = -h + \frac{∂h}{∂q} (± G)^T K^{-1} r.

The equations hold for a body and for its modes alike: what they need is `BorderedBody`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from shared_schema.actuators import Control
from shared_schema.common.errors import WorkError
from surrogate.mechanics.equilibrium.halved_steps import halved_steps

Array = NDArray[np.float64]
ITERATIONS, HALVINGS = 25, 8
SETTLED = 1e-9  # of a step beside the state
CONTRACTION = 0.25  # of steps with one tangent
STIFF = 1e6  # N/m: of a cable that is taut or not


class Residual(NamedTuple):
    """A state's lack of balance.

    Attributes
    ----------
    forces : array, (n,)
        r in N, or in J in modes.
    units : array, (n_units, n)
        g of every unit.
    quantities : array, (n_units,)
        q in m or m³.
    """

    forces: Array
    units: Array
    quantities: Array


class BorderedBody(Protocol):
    """A body under actuators, in n unknowns."""

    @property
    def signs(self) -> Array:
        """Those of g = ± ∂q/∂u, (n_units,)."""

    @property
    def least(self) -> float:
        """Size in m of a step that rounding errors make."""

    def under(self, part: float) -> Self:
        """The body under a part of its dead load."""

    def residual(self, state: Array, amplitudes: Array) -> Residual | None:
        """Lack of balance under some amplitudes; None where a cell is inverted."""

    def inverse_at(
        self, state: Array, amplitudes: Array, rough: bool = False
    ) -> Callable[[Array], Array]:
        """K⁻¹ of right sides, (m, n) → same; a rough one may be of another state."""


class Balanced(NamedTuple):
    """A state in equilibrium.

    Attributes
    ----------
    state : array, (n,)
    amplitudes : array, (n_units,)
        In Pa or N.
    """

    state: Array
    amplitudes: Array


def balanced(
    body: BorderedBody, controls: Sequence[Control], start: Balanced, tolerance: float = SETTLED
) -> Balanced:
    """Find the equilibrium under given controls, from one nearby or from the body at rest.

    Where Newton's method does not lead there at once, what is given, and the dead load, are
    increased from rest.

    Raises
    ------
    WorkError
        If there is no way.
    """
    found = newton(body, controls, 1.0, start, tolerance)
    if found is not None:
        return found

    def go(share: float, last: Balanced) -> Balanced:
        reached = newton(body.under(share), controls, share, last, tolerance)
        if reached is None:
            raise WorkError("Newton's method does not settle")
        return reached

    at_rest = Balanced(np.zeros_like(start.state), np.zeros_like(start.amplitudes))
    return halved_steps(go, at_rest, "no equilibrium beyond {:.2%} of what the actuators do")


def newton(
    body: BorderedBody, controls: Sequence[Control], part: float, start: Balanced, tolerance: float
) -> Balanced | None:
    """Newton's method at a load factor; None if it does not settle."""
    state, amplitudes = start
    fixed = all(control.gives_amplitude for control in controls)
    if fixed:
        amplitudes = np.array([control.target(part) for control in controls])
    residual = body.residual(state, amplitudes)
    if residual is None:
        return None
    solve, rough = body.inverse_at(state, amplitudes, rough=True), True
    step = _step(body, solve, controls, part, residual, amplitudes)
    for _ in range(ITERATIONS):
        size = float(np.linalg.norm(step.state))
        if size <= max(tolerance * float(np.linalg.norm(state)), body.least):
            return Balanced(state + step.state, amplitudes + step.amplitudes)
        advanced = _damped(body, solve, controls, part, state, amplitudes, step)
        if advanced is None:
            if not rough:
                return None
        else:
            state, amplitudes, residual, after = advanced
            if np.linalg.norm(after.state) <= CONTRACTION * size:
                step = after  # with the same tangent
                continue
        solve, rough = body.inverse_at(state, amplitudes), False
        step = _step(body, solve, controls, part, residual, amplitudes)
    return None


def _step(
    body: BorderedBody,
    solve: Callable[[Array], Array],
    controls: Sequence[Control],
    part: float,
    residual: Residual,
    amplitudes: Array,
) -> Balanced:
    """δu and δa."""
    if all(control.gives_amplitude for control in controls):
        return Balanced(-solve(residual.forces[None])[0], np.zeros_like(amplitudes))
    each = zip(controls, amplitudes, residual.quantities, strict=True)
    rows = np.array([c.equation(part, float(a), float(q), STIFF) for c, a, q in each])
    value, by_amplitude, by_quantity, _ = rows.T
    responses = solve(np.concatenate([residual.forces[None], residual.units]))
    back, moved = responses[0], responses[1:]
    of_quantities = (body.signs * by_quantity)[:, None] * residual.units
    matrix = of_quantities @ moved.T + np.diag(by_amplitude)
    change = np.linalg.solve(matrix, of_quantities @ back - value)
    return Balanced(change @ moved - back, change)


def _damped(
    body: BorderedBody,
    solve: Callable[[Array], Array],
    controls: Sequence[Control],
    part: float,
    state: Array,
    amplitudes: Array,
    step: Balanced,
) -> tuple[Array, Array, Residual, Balanced] | None:
    """The longest part of a step after which the simplified step is shorter (Deuflhard 2004).

    With that step.
    """
    size = np.linalg.norm(step.state)
    for halving in range(HALVINGS):
        share = 0.5**halving
        trial, other = state + share * step.state, amplitudes + share * step.amplitudes
        residual = body.residual(trial, other)
        if residual is None:
            continue
        after = _step(body, solve, controls, part, residual, other)
        if np.linalg.norm(after.state) <= (1 - share / 4) * size:
            return trial, other, residual, after
    return None


def moved_by(body: BorderedBody, controls: Sequence[Control], at: Balanced) -> Array:
    """Derivatives of a state in equilibrium by what is given of each actuator: (n_units, n)."""
    return followed(body, controls, at, np.zeros((0, len(at.state))))[2]


def followed(
    body: BorderedBody, controls: Sequence[Control], near: Balanced, forces: Array
) -> tuple[Balanced, float, Array]:
    """A step of Newton's method from nearby, and derivatives of the state, by one tangent.

    Parameters
    ----------
    body, controls
    near : Balanced
        A state close to the equilibrium.
    forces : array, (m, n)
        Dead forces.

    Returns
    -------
    Balanced
        After the step.
    float
        Work in J of the lack of balance along the step, twice the energy that it frees.
    array, (n_units + m, n)
        Derivatives by what is given of each actuator, and by factors on the forces.

    Raises
    ------
    WorkError
        If a cell is inverted there.
    """
    state, amplitudes = near
    if all(control.gives_amplitude for control in controls):
        amplitudes = np.array([control.value for control in controls])
    residual = body.residual(state, amplitudes)
    if residual is None:
        raise WorkError("a cell is inverted")
    solve = body.inverse_at(state, amplitudes)
    step = _step(body, solve, controls, 1.0, residual, amplitudes)
    moved, count = solve(np.concatenate([residual.units, forces])), len(amplitudes)
    each = zip(controls, amplitudes, residual.quantities, strict=True)
    rows = np.array([c.equation(1.0, float(a), float(q), STIFF) for c, a, q in each])
    _, by_amplitude, by_quantity, by_given = rows.T
    of_quantities = (body.signs * by_quantity)[:, None] * residual.units
    matrix = of_quantities @ moved[:count].T + np.diag(by_amplitude)
    right = np.concatenate([-np.diag(by_given), -of_quantities @ moved[count:].T], axis=1)
    found = np.linalg.solve(matrix, right).T @ moved[:count]
    found[count:] += moved[count:]
    freed = abs(float(residual.forces @ step.state))
    after = Balanced(state + step.state, amplitudes + step.amplitudes)
    return after, freed, np.asarray(found)
