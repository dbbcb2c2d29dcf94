r"""A body in motion, step by step.

Generalised-α (Chung and Hulbert 1993; `shared_schema.motion.scheme`) weights the forces of a step,
so that its end u' is an equilibrium with inertia (`surrogate.mechanics.equilibrium.inertia`). It is
found by directions from where the body coasts (`surrogate.mechanics.motion.one_step`). Velocity and
acceleration follow from u', and so do the forces out of balance that the next step takes over: what
a step has left is an error of its forces, and no momentum is lost to it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shared_schema.common.arguments import checked_arguments, real_numbers
from shared_schema.common.bodies.command_loads import CommandLoads
from shared_schema.common.errors import InputError
from shared_schema.motion import Damping, Scheme, densities_of_cells
from shared_schema.tools import Tool, require_outside
from surrogate.mechanics.certify.full_certificate import certified_at_points
from surrogate.mechanics.descent.aim import require_positive
from surrogate.mechanics.equilibrium.following_loads import FollowingLoads
from surrogate.mechanics.equilibrium.inertia import Inertia, Masses
from surrogate.mechanics.equilibrium.out_of_balance import Equilibrium
from surrogate.mechanics.motion.contact import ToolForces, require_no_jump
from surrogate.mechanics.motion.frame import Frame, Moment
from surrogate.mechanics.motion.moving_body import MovingBody
from surrogate.mechanics.motion.one_step import Contraction, settled, start_of
from surrogate.mechanics.statics.body import Body
from surrogate.mechanics.statics.load import GivenLoad, Load
from surrogate.mechanics.touch.grip import Held, at_points, texts_of_held
from surrogate.mechanics.touch.loaded_body import LinearBody
from surrogate.mechanics.touch.tool_contact import ToolContact

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
TOLERANCE = 5e-3  # of the largest displacement
KEPT = 4  # lengths of steps and places held, whose factors are kept


class HasBody(Protocol):
    """What has a body: a `Surrogate`, or a `Series`."""

    body: Body


@dataclass(frozen=True)
class Places:
    """Components that are held at all points, (n_points, d), and where in m."""

    held: Flags
    displacement: Array


class Session:
    """A body in motion.

    >>> session = Session(surrogate.load("beam2d_any"), density=1.0)     # doctest: +SKIP
    >>> for _ in range(60):                                              # doctest: +SKIP
    ...     frame = session.step(1 / 60, "4,1:0,-1")                     # doctest: +SKIP
    >>> frame.displacement, frame.energies.drift                         # doctest: +SKIP

    Parameters
    ----------
    model : Body, or what has one, as a `Surrogate`
    density : float, optional
        Mass of the undeformed body over its volume in kg/m³; by default, that of its materials.
    dissipation : float, optional
        ρ∞ of the scheme, from 0 to 1: what a step leaves of a vibration that is too fast for it.
        By default, and so for damping and mass, that of the case's `time`, or 0.8.
    damping : Damping, optional
    mass : {"consistent", "lumped"}, optional
    tolerance : float
        Largest estimated error that a step adds, over the largest displacement.

    Attributes
    ----------
    time : float
        In s.

    Raises
    ------
    InputError
        If a material has no density, a number is wrong, or the learner does not know the body.
    """

    @checked_arguments
    def __init__(
        self,
        model: Body | HasBody,
        *,
        density: float | None = None,
        dissipation: float | None = None,
        damping: Damping | None = None,
        mass: str | None = None,
        tolerance: float = TOLERANCE,
    ) -> None:
        require_positive("tolerance", tolerance)
        require_positive("density", density)
        self.body = model if isinstance(model, Body) else model.body
        known = self.body.case.get("time") or {}
        self._dissipation = known.get("dissipation", 0.8) if dissipation is None else dissipation
        if not 0 <= self._dissipation <= 1:
            raise InputError(f"dissipation {dissipation}: expected 0 to 1", "dissipation")
        self._damping = Damping(**known.get("damping", {})) if damping is None else damping
        kind = mass or known.get("mass", "consistent")
        if kind not in ("consistent", "lumped"):
            raise InputError(f"mass '{kind}': expected consistent or lumped", "mass")
        self.tolerance, self._lumped = tolerance, kind == "lumped"
        geometry, cells = self.body.geometry, len(self.body.geometry.cells)
        self._density = np.full(cells, density)
        if density is None:
            self._density = densities_of_cells(self.body.material, geometry.parts, cells)
        self._equilibrium = self.body.equilibrium
        self._surface = np.asarray(geometry.surface_nodes, np.int64)
        self._surface = self._surface[geometry.free[self._surface].any(axis=1)]
        d = geometry.dimension
        self._components = (self._surface[:, None] * d + np.arange(d)).ravel()
        self._masses: dict[float, Masses] = {}
        self._moving: dict[tuple[float, bytes], tuple[MovingBody, LinearBody]] = {}
        self._read: tuple[object, Load] | None = None
        self.begin()

    def in_steps(self, seconds: float) -> MovingBody:
        """The body in steps of a length in s."""
        return self._body_in_steps(seconds, np.zeros(self._equilibrium.free.shape, bool))[0]

    @property
    def displacement_of_points(self) -> Array:
        """Displacement now of all points of the elements in m, (n_points, d)."""
        return (self._u if self._now is None else self._now.u).copy()

    def begin(
        self,
        load: GivenLoad | CommandLoads | Load | None = None,
        *,
        displacement: ArrayLike | None = None,
        velocity: ArrayLike | None = None,
        acting: GivenLoad | CommandLoads | Load | None = None,
    ) -> None:
        """Begin anew at t = 0: at rest, or in a given state.

        Parameters
        ----------
        load : Load, or as `Surrogate.solve` takes it, optional
            One under which the body is in equilibrium.
        displacement, velocity : array, (n_nodes, d), optional
            In m and m/s, instead.
        acting : as load, optional
            What acts at t = 0; by default the load of the first step.

        Raises
        ------
        InputError
            If a load or a shape is wrong.
        WorkError
            If there is no equilibrium.
        """
        body, shape = self._equilibrium, self.body.geometry.coordinates.shape
        if load is not None and displacement is not None:
            raise InputError("begin: expected a load or a displacement, not both")
        fields = []
        for name, given in (("displacement", displacement), ("velocity", velocity)):
            field = np.zeros(shape) if given is None else real_numbers(given, name)
            if field.shape != shape or not np.isfinite(field).all():
                raise InputError(f"{name} has shape {field.shape}, expected {shape}, finite")
            fields.append(body.interpolated(np.where(body.free[: body.nodes], field, 0.0)[None])[0])
        u, v = fields
        if load is not None:
            under = self._load(load)
            start = under.at_rest(self.body.geometry)
            found = self.body.correct(
                under, body.linear_response(body.forces_at_points(start[None]))[0, : body.nodes]
            )
            f = body.forces_at_points(under.dead[None])
            at = body if under.following is None else body.under(under.following)
            u = at.at_points(found.displacement[None], f)[0]
        self.time, self._work, self._dissipated = 0.0, 0.0, 0.0
        self._acting = None if acting is None else self._load(acting)
        self._u, self._v = u, v
        self._now: Moment | None = None
        self._tool: Tool | None = None
        self._forces = np.zeros(len(self._components))
        self._contraction = Contraction()

    @checked_arguments
    def step(
        self,
        seconds: float,
        load: GivenLoad | CommandLoads | Load | None = None,
        *,
        tool: Tool | None = None,
        held: Held | None = None,
        actuation: Mapping[str, float] | Sequence[str] = (),
        certify: bool = False,
    ) -> Frame:
        """Take a step.

        Parameters
        ----------
        seconds : float
            Its length h in s. The first step of another length takes a factorisation.
        load : Load, or as `Surrogate.solve` takes it, optional
            What acts at the end of the step; none by default.
        tool : Tool, optional
            Where a tool is then, which lets no node of the surface enter.
        held : mapping of str to displacements, or sequence of str, optional
            Places that grips hold then, as of `Grip`, beside the supports.
        actuation : mapping of str to float, or sequence of str
            Tensions in N and pressures in Pa of actuators by their names.
        certify : bool
            Whether the error that this step adds is certified, by Newton's method.

        Raises
        ------
        InputError
            If an argument is wrong, or the tool jumps through the body.
        WorkError
            If no end of the step is found.
        """
        require_positive("seconds", seconds)
        given = self._load(load, actuation)
        places = self._places(held)
        moving, linear = self._body_in_steps(seconds, places.held)
        body = moving.equilibrium
        dead = self._equilibrium.forces_at_points(given.dead[None])[0]
        following = given.following
        if following is not None and not following.amplitudes.any():
            following = None
        last = self._last(moving, dead, following)
        if (body.free & ~last.equilibrium.free).any():
            left = last.left_of_free(body)
            last = replace(last, a=moving.acceleration(-left), left=left)
        step = Inertia.of(moving.masses, last.u, last.v, last.a, last.left)
        driven = moving.in_step(step, following)
        following = driven.equilibrium.following
        on = last.u + seconds * last.v, last.u
        starts = tuple(np.where(body.free, u, places.displacement) for u in on)
        contact = self._contact(tool, starts[0], linear)
        end = settled(
            driven,
            dead,
            start_of(driven, dead, starts),
            self.tolerance,
            self._contraction,
            contact,
        )
        scheme, begun, masses = moving.masses.scheme, step.begun, moving.masses
        u = end.u
        a = scheme.acceleration(begun, u)
        left = scheme.left(masses.matrix, a, last.a, last.left)
        pushed = np.zeros_like(u) if contact is None else contact.at_points
        given_fields = u, scheme.velocity(begun, u), a, dead, pushed, following, left * body.free
        now = Moment(body, masses, *given_fields)
        self._account(last, now)
        certificate = None
        if certify:
            certificate = certified_at_points(driven.equilibrium, dead + pushed, u)
        self.time, self._now, self._tool = self.time + seconds, now, tool
        self._forces = np.zeros_like(self._forces) if contact is None else contact.force
        nodes = self._equilibrium.nodes
        return Frame(
            self.time,
            u[:nodes].copy(),
            now.v[:nodes].copy(),
            end.estimate if certificate is None else float(certificate.max_error),
            end.directions,
            pushed[:nodes],
            certificate,
            now,
            self._work,
            self._dissipated,
            self._first,
        )

    def _load(
        self,
        load: GivenLoad | CommandLoads | Load | None,
        actuation: Mapping[str, float] | Sequence[str] = (),
    ) -> Load:
        """Read a load; that of the last step is not read again."""
        if isinstance(load, Load):
            return load
        texts = isinstance(load, str) or load is None
        key = (load, tuple(actuation.items()) if isinstance(actuation, Mapping) else actuation)
        if texts and self._read is not None and self._read[0] == key:
            return self._read[1]
        if actuation and self.body.geometry.actuators is None:
            raise InputError("actuation: the case has no actuators", "actuation")
        found = Load.of(self.body.geometry, load, actuate=actuation)
        self._read = (key, found) if texts else None
        return found

    def _places(self, held: Held | None) -> Places:
        """What grips hold where."""
        geometry, body = self.body.geometry, self._equilibrium
        nothing = np.zeros(body.free.shape)
        if not held:
            return Places(nothing.astype(bool), nothing)
        together = CommandLoads(geometry.loaded_body)
        for text in texts_of_held(held, geometry.dimension):
            together.move(text)
        moved = np.where(together.moved, together.displacement, 0.0)
        return Places(at_points(geometry, together.moved), body.interpolated(moved[None])[0])

    def _body_in_steps(self, seconds: float, held: Flags) -> tuple[MovingBody, LinearBody]:
        """The body in steps of a length, with places held."""
        key = seconds, np.packbits(held).tobytes()
        if key not in self._moving:
            body, scheme = (
                self._equilibrium,
                Scheme.generalised_alpha(seconds, self._dissipation, self._damping.mass),
            )
            if held.any():
                single = body.geometry.held | held
                body = Equilibrium(replace(body.geometry, single=single), body.material)
            masses = next(iter(self._masses.values()), None)
            if masses is None:
                of = body.solid, body.geometry, scheme, self._density
                masses = Masses.of(*of, self._damping.stiffness, self._lumped)
            masses = self._masses.setdefault(seconds, masses.in_steps(scheme))
            moving = MovingBody(body, masses)
            linear = LinearBody(moving.driven.equilibrium, self._components)
            while len(self._moving) >= KEPT:
                del self._moving[next(iter(self._moving))]
            self._moving[key] = moving, linear
        return self._moving[key]

    def _last(self, moving: MovingBody, dead: Array, following: FollowingLoads | None) -> Moment:
        """What a step begins at; at t = 0 with the acceleration of the load there."""
        if self._now is not None:
            return self._now
        zero, body, at = np.zeros_like(dead), moving.equilibrium, following
        if self._acting is not None:
            dead = self._equilibrium.forces_at_points(self._acting.dead[None])[0]
            at = self._acting.following
        first = Moment(
            body,
            moving.masses,
            self._u,
            self._v,
            zero,
            dead,
            zero,
            at if at is None else replace(at, coordinates=body.geometry.coordinates),
            zero,
        )
        internal = body.solid.compiled.internal_forces(self._u[None])[0]
        left = (internal + first.damping - first.external) * body.free
        self._first = replace(first, a=moving.acceleration(-left), left=left)
        return self._first

    def _contact(self, tool: Tool | None, u: Array, linear: LinearBody) -> ToolForces | None:
        """The forces of a tool, which begin as those of the last step."""
        if tool is None:
            return None
        geometry = self.body.geometry
        require_outside(tool, geometry.coordinates, geometry.free)
        at_rest = geometry.coordinates[self._surface]
        if self._tool is not None:
            require_no_jump(at_rest + u[self._surface], self._tool, tool)
        return ToolForces(ToolContact(tool, at_rest), linear, u.shape, self._forces)

    def _account(self, last: Moment, now: Moment) -> None:
        """Add up work and dissipation of a step."""
        moved = now.u - last.u
        forces = last.external + now.external
        if np.any(moved[~now.equilibrium.free]):
            forces = forces + last.supported + now.supported
        self._work += float(np.vdot(forces, moved)) / 2
        self._dissipated += float(np.vdot(last.damping + now.damping, moved)) / 2
