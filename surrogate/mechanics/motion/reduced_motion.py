r"""A body in motion in modes of its displacement: steps of a millisecond, for loads that are known.

Modes Φ come from motions of the whole body (`surrogate.mechanics.motion.session`) under the loads
and actuators, as they vary at random; forces in them are those of a few weighted cells
(`surrogate.mechanics.actuation.reduced_body`). A step of generalised-α is then

.. math:: Φ^T \big(f_{int}(Φ q') + f_v\big) + k M_r q' = Φ^T f' + (A ũ)_r, \qquad M_r = Φ^T M Φ,

the equation of `surrogate.mechanics.equilibrium.inertia` in few unknowns. Newton's method begins at
q + h v with the tangent of the last step, and takes another one where steps do not fall fast. Only
loads like those of the fit are known to the modes, and no error is estimated: the whole body's
session does that.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.stats.qmc import LatinHypercube

from shared_schema.actuators import Control
from shared_schema.common.arguments import checked_arguments, real_numbers
from shared_schema.common.errors import InputError, WorkError
from shared_schema.motion import Begun, Scheme
from surrogate.mechanics.actuation.actuated_body import ActuatedModes
from surrogate.mechanics.actuation.bordered import Balanced, Residual, balanced, newton
from surrogate.mechanics.actuation.reduced_body import ReducedBody, modes_of, sampled_cells
from surrogate.mechanics.equilibrium.inertia import Masses
from surrogate.mechanics.motion.session import HasBody, Session
from surrogate.mechanics.statics.body import Body
from surrogate.mechanics.statics.load import Load

Array = NDArray[np.float64]
STEP, MODES, MOTIONS = 1 / 60, 60, 24
STEPS, EVERY = 30, 3  # of a motion; steps between states that modes are taken from
LET_GO = 3  # one motion in so many
LARGEST = 1.2  # factor on a load, of those that are to come
FREQUENCIES = 0.2, 1.5  # of loads over that of the slowest vibration
ACCURACY = 1e-3  # of these motions
SETTLED = 1e-3  # of a step of Newton's method beside the state


@dataclass(frozen=True)
class ModalMasses:
    """Inertia and viscosity in modes.

    Attributes
    ----------
    scheme : Scheme
    matrix : array, (n_modes, n_modes)
        M_r in kg.
    damping : array, (n_modes, n_modes)
        ∂f_v/∂v of the modes at rest, in kg/s; it is in tangents alone.
    viscous : callable
        Works of f_v on the modes in J, of coefficients in m and their rates in m/s.
    """

    scheme: Scheme
    matrix: Array
    damping: Array
    viscous: Callable[[Array, Array], Array]

    @classmethod
    def of(cls, masses: Masses, reduced: ReducedBody, sampled: NDArray[np.int64]) -> ModalMasses:
        """Of a body's masses; viscous forces are those of sampled cells."""
        modes = reduced.modes
        matrix = np.einsum("mnd,knd->mk", modes, np.stack([masses.matrix @ each for each in modes]))
        damping, viscosity = np.zeros_like(matrix), masses.viscosity
        if viscosity is None:
            return cls(masses.scheme, matrix, damping, lambda q, v: np.zeros(len(q)))
        for mode, row in zip(modes, damping, strict=True):
            row[:] = reduced.works_of(masses.viscous_forces(np.zeros_like(mode), mode))
        at_nodes, shape = reduced.at_nodes, (len(reduced.points), modes.shape[2])
        compiled, of_cells = reduced.elements.compiled, viscosity[sampled]

        def viscous(q: Array, v: Array) -> Array:
            u, rate = ((at_nodes @ each).reshape(shape) for each in (q, v))
            return np.asarray(at_nodes.T @ compiled.viscous_forces(of_cells, u, rate).ravel())

        return cls(masses.scheme, matrix, damping, viscous)

    @property
    def tangent(self) -> Array:
        """What a step adds to K, (n_modes, n_modes)."""
        return self.scheme.spring * self.matrix + self.scheme.damping_slope * self.damping


@dataclass
class MovingModes:
    """Coefficients of modes in one time step, as `bordered.newton` solves it.

    Attributes
    ----------
    modes : ActuatedModes
        Without inertia.
    masses : ModalMasses
    begun : Begun
    pull : array, (n_modes,)
        A ũ of the modes in N.
    inverse : array, (n_modes, n_modes), or None
        That of the last tangent.
    """

    modes: ActuatedModes
    masses: ModalMasses
    begun: Begun
    pull: Array
    inverse: Array | None

    @property
    def signs(self) -> Array:
        """Those of g = ± ∂q/∂u."""
        return self.modes.signs

    @property
    def least(self) -> float:
        """Size in m of a step that rounding errors make."""
        return self.modes.least

    def under(self, part: float) -> Self:
        """The step under a part of its dead load."""
        return replace(self, modes=self.modes.under(part))

    def residual(self, state: Array, amplitudes: Array) -> Residual | None:
        """Works of the out-of-balance forces on the modes in J."""
        found, masses = self.modes.residual(state, amplitudes), self.masses
        if found is None:
            return None
        scheme = masses.scheme
        viscous = masses.viscous(state, scheme.damping_velocity(self.begun, state))
        inertia = scheme.spring * (masses.matrix @ state) - self.pull
        return found._replace(forces=found.forces + viscous + inertia)

    def inverse_at(
        self, state: Array, amplitudes: Array, rough: bool = False
    ) -> Callable[[Array], Array]:
        """(K + A)⁻¹; a rough one is that of the last step."""
        if self.inverse is None or not rough:
            body = self.modes.body
            k = body.tangent(state) - body.following_slopes(state, amplitudes)
            self.inverse = np.asarray(np.linalg.inv(k + self.masses.tangent), float)
        inverse = self.inverse
        return lambda right: np.asarray(right @ inverse.T)


class ReducedMotion:
    """A body in motion in modes, step by step.

    >>> motion = ReducedMotion(model, ["4,1:0,-1"], density=1.0)        # doctest: +SKIP
    >>> for n in range(60):                                             # doctest: +SKIP
    ...     u = motion.step([np.sin(0.1 * n)])                          # doctest: +SKIP

    Parameters
    ----------
    model : Body, or what has one, as a `Surrogate`
    loads : sequence of str
        Loads of factor 1, as ``--load`` has them; factors are to be from -1 to 1. Actuators of the
        body are to be within their limits.
    step : float
        Length of all steps in s.
    modes, motions, seed : int
        Number of modes at most; number of motions of the whole body that they come from, and seed
        of what drives these.
    **of_session
        `density`, `dissipation`, `damping` and `mass` of a `Session`.

    Attributes
    ----------
    body : Body
    reduced : ReducedBody
    time : float
        In s.

    Raises
    ------
    InputError
        If an argument is wrong, or there is neither a load nor an actuator.
    WorkError
        If a motion of the whole body fails.
    """

    @checked_arguments
    def __init__(
        self,
        model: Body | HasBody,
        loads: Sequence[str] = (),
        *,
        step: float = STEP,
        modes: int = MODES,
        motions: int = MOTIONS,
        seed: int = 0,
        **of_session: Any,
    ) -> None:
        for name, value in {"modes": modes, "motions": motions, "step": step}.items():
            if not 0 < value < np.inf:
                raise InputError(f"{name} {value}: expected a number above 0", name)
        session = Session(model, **{"tolerance": ACCURACY, **of_session})
        self.body = session.body
        body, actuators = self.body.equilibrium, self.body.geometry.actuators
        self._actuators = actuators
        if not loads and actuators is None:
            raise InputError("loads: expected some, of a body without actuators", "loads")
        each = [Load.of(self.body.geometry, text) for text in loads]
        self._loads = np.array([body.forces_at_points(load.dead[None])[0] for load in each])
        driven = Driven(session, each, step, np.random.default_rng(seed))
        fields, amplitudes = driven.states(motions)
        units = () if actuators is None else actuators.loads
        found = modes_of(fields, modes)
        flat = found.reshape(len(found), -1)
        q = np.asarray(np.linalg.lstsq(flat.T, fields.reshape(len(fields), -1).T)[0].T, float)
        sample = sampled_cells(body, units, found, q, amplitudes, seed)
        self.reduced = ReducedBody(body, units, found, sample)
        self._masses = ModalMasses.of(session.in_steps(step).masses, self.reduced, sample.cells)
        self._works = np.array([self.reduced.works_of(load) for load in self._loads])
        self._inverse: Array | None = None
        self.begin()

    def begin(
        self, factors: ArrayLike | None = None, actuation: Mapping[str, float] | None = None
    ) -> None:
        """Begin anew at t = 0: in equilibrium under factors on the loads and actuators, or at rest.

        Raises
        ------
        InputError
            If an argument is wrong.
        WorkError
            If there is no equilibrium.
        """
        count = len(self.reduced.modes)
        start = Balanced(np.zeros(count), np.zeros(len(self.reduced.units)))
        controls = self._controls(actuation)
        if factors is not None or actuation is not None:
            start = balanced(self._modes(factors), controls, start)
        self.time, self._first = 0.0, True
        self._q, zero = start.state, np.zeros_like(start.state)
        self._v, self._a, self._left = zero, zero, zero

    @checked_arguments
    def step(
        self, factors: ArrayLike | None = None, actuation: Mapping[str, float] | None = None
    ) -> Array:
        """Take a step; the displacement at its end in m, (n_nodes, d).

        Parameters
        ----------
        factors : array, (n_loads,), optional
            On the loads at the end of the step; 0 by default.
        actuation : mapping of str to float, optional
            Tensions in N and pressures in Pa of actuators by their names; at rest by default.

        Raises
        ------
        InputError
            If an argument is wrong.
        WorkError
            If no end of the step is found.
        """
        modes, controls, masses = self._modes(factors), self._controls(actuation), self._masses
        amplitudes = np.array([control.target(1.0) for control in controls])
        scheme, q, v = masses.scheme, self._q, self._v
        if self._first:  # what acts at t = 0 is what acts at the end of the step
            there = modes.residual(q, amplitudes)
            if there is None:
                raise WorkError("the motion inverts a cell of the body")
            self._left = there.forces + masses.viscous(q, v)
            self._a = -np.asarray(np.linalg.solve(masses.matrix, self._left), float)
            self._first = False
        begun = scheme.begin(q, v, self._a)
        pull = scheme.pull(masses.matrix, begun, self._left)
        moving = MovingModes(modes, masses, begun, pull, self._inverse)
        for start in (q + scheme.step * v, q):
            found = newton(moving, controls, 1.0, Balanced(start, amplitudes), SETTLED)
            if found is not None:
                break
        else:
            raise WorkError("the end of a time step is not found: take shorter time steps")
        self._inverse, self._q = moving.inverse, found.state
        a = scheme.acceleration(begun, found.state)
        self._left = scheme.left(masses.matrix, a, self._a, self._left)
        self._v, self._a = scheme.velocity(begun, found.state), a
        self.time += scheme.step
        return self.displacement

    @property
    def displacement(self) -> Array:
        """Displacement now in m, (n_nodes, d)."""
        return self.reduced.displacement(self._q)[: len(self.body.geometry.coordinates)]

    def _modes(self, factors: ArrayLike | None) -> ActuatedModes:
        """Forces in modes under factors on the loads."""
        count = len(self._works)
        given = np.zeros(count) if factors is None else real_numbers(factors, "factors")
        if given.shape != (count,) or not np.isfinite(given).all():
            raise InputError(f"factors: expected {count} finite numbers", "factors")
        work = given @ self._works if count else np.zeros(len(self.reduced.modes))
        return ActuatedModes(self.reduced, work, measures=False)

    def _controls(self, actuation: Mapping[str, float] | None) -> tuple[Control, ...]:
        if not actuation and self._actuators is None:
            return ()
        if self._actuators is None:
            raise InputError("actuation: the case has no actuators", "actuation")
        controls = self._actuators.given([f"{k}={v!r}" for k, v in (actuation or {}).items()])
        if not all(control.gives_amplitude for control in controls):
            raise InputError("actuation: expected tensions and pressures in a motion", "actuation")
        return controls


@dataclass(frozen=True)
class Driven:
    """Motions of the whole body under what varies at random.

    Amplitudes and frequencies are those of a Latin hypercube (McKay et al. 1979), so that few
    motions have large ones as well.

    Attributes
    ----------
    session : Session
    loads : sequence of Load
    step : float
        In s.
    random : Generator
    """

    session: Session
    loads: Sequence[Load]
    step: float
    random: np.random.Generator

    def states(self, motions: int) -> tuple[Array, Array]:
        """Displacements of all points in m, (n, n_points, d), and amplitudes, (n, n_actuators)."""
        geometry, n = self.session.body.geometry, len(self.loads)
        low = self.session.in_steps(self.step).frequency / (2 * np.pi)
        actuators = () if geometry.actuators is None else geometry.actuators.actuators
        names = () if geometry.actuators is None else geometry.actuators.names
        limits = np.array([each.limits for each in actuators]).reshape(-1, 2).T
        fields, amplitudes, of_actuators = [], [], len(actuators)
        let_go = -(-motions // LET_GO)
        drawn = [
            LatinHypercube(2 * (n + of_actuators), seed=self.random).random(count)
            for count in (let_go, motions - let_go)
        ]
        for motion, row in enumerate(np.concatenate(drawn)):
            lets_go = motion < let_go
            most, share, rates = np.split(row, [n, n + of_actuators])
            most = LARGEST * (2 * most - 1)
            values = limits[0] + share * np.ptp(limits, axis=0)
            rates = low * (FREQUENCIES[0] + np.ptp(FREQUENCIES) * rates)
            held = self._load(most, dict(zip(names, values.tolist(), strict=True)))
            self.session.begin(held if lets_go else None)
            for number in range(1, STEPS + 1):
                waves = np.sin(2 * np.pi * rates * number * self.step) * (not lets_go)
                now = values * np.abs(waves[n:])
                given = dict(zip(names, now.tolist(), strict=True))
                self.session.step(self.step, self._load(most * waves[:n], given))
                if number % EVERY == 0:
                    fields.append(self.session.displacement_of_points)
                    amplitudes.append(now)
        return np.array(fields), np.array(amplitudes)

    def _load(self, factors: Array, actuation: Mapping[str, float]) -> Load:
        geometry = self.session.body.geometry
        found = Load.of(geometry, actuate=actuation) if actuation else Load.of(geometry)
        for factor, load in zip(factors, self.loads, strict=True):
            found = replace(found, dead=found.dead + factor * load.dead)
        return found
