"""The load on a body: dead forces, and pressures and cables that follow it.

Dead forces are nodal ones, and after these, of elements with points between the nodes, the forces
there (`surrogate.mechanics.equilibrium.quadratic`). A load is read from arrays, or from texts and
files as a command takes them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray
from torch import Tensor

from shared_schema.common.arguments import real_numbers
from shared_schema.common.bodies.command_loads import CommandLoads, command_loads
from shared_schema.common.errors import InputError
from surrogate.mechanics.body.geometry import Geometry
from surrogate.mechanics.equilibrium.following_loads import FollowingLoads

ROUNDING = 1e-6  # of a force in single precision, and more
FAINT = 1e-4  # of the forces of actuators
LARGEST_FORCE = float(np.finfo(np.float32).max)
Array = NDArray[np.float64]
GivenLoad: TypeAlias = ArrayLike | Tensor | str | Path | Sequence[str | Path]


@dataclass(frozen=True)
class Load:
    """What acts on a body in one load case, or in N of them.

    Attributes
    ----------
    dead : array, (n_nodes or n_points, d) or with N before
        Dead forces in N, with what acts between the nodes after the nodal ones.
    following : FollowingLoads or None
        Pressures and cables of the load cases, which follow the body.
    """

    dead: Array
    following: FollowingLoads | None = None

    @classmethod
    def of(
        cls,
        geometry: Geometry,
        load: GivenLoad | CommandLoads | None = None,
        *,
        nearest: bool = False,
        body_force: str | Sequence[float] | None = None,
        actuate: Mapping[str, float] | Sequence[str] = (),
    ) -> Load:
        """Read one load case, as `given_load` does; no load at all is none.

        Tensions in N and pressures in Pa of actuators are numbers by their names, or the texts of
        ``--actuate``; actuators that are not named do nothing.
        """
        if not isinstance(load, CommandLoads):
            given = () if load is None else load
            load = given_load(geometry, given, nearest, body_force, needed=False)
        between = load.between if load.between.any() else load.between[:0]
        dead = np.concatenate([load.forces, between])
        pressed = FollowingLoads.of_load(load)
        if geometry.actuators is None:
            return cls(dead, pressed)
        actuated = FollowingLoads.of(geometry, actuated_amplitudes(geometry, actuate)[None])
        return cls(dead, actuated if pressed is None else pressed.beside(actuated))

    @classmethod
    def told_apart(
        cls, geometry: Geometry, forces: Array, pressure: ArrayLike | None = None
    ) -> Load:
        """Tell given pressures from the dead forces beside them.

        Parameters
        ----------
        geometry : Geometry
        forces : array, (n_nodes or n_points, d) or with N before
            Checked loads in N, with the forces of pressures on the undeformed body.
        pressure : array, (n_surfaces,) or (N, n_surfaces)
            As of `checked_pressure`.
        """
        follows = checked_pressure(geometry, pressure, forces)
        return cls(dead_part(geometry, forces, follows), follows)

    @classmethod
    def of_samples(cls, geometry: Geometry, forces: Array) -> Load:
        """Tell the pressures of samples from their dead forces, which a dataset holds as one sum.

        The pressure of a surface is the median of those that explain the force of each of its
        nodes. It is exact if fewer than half of these have another force.

        Parameters
        ----------
        geometry : Geometry
        forces : array, (N, n_nodes, d)
            Loads in N, with the forces of pressures on the undeformed body.

        Raises
        ------
        InputError
            If another force acts on half of the nodes, no node belongs to one surface alone, or
            other forces act beside actuators.
        """
        if geometry.actuators is not None:
            return cls._of_actuators(geometry, forces)
        if not geometry.surfaces:
            return cls(forces)
        count, nodes = len(geometry.surfaces), len(geometry.coordinates)
        of_units = checked_pressure(geometry, -np.eye(count), np.zeros((count, 1, 1)))
        assert of_units is not None
        areas = of_units.load[:, :nodes] * geometry.free
        own = areas.any(axis=2) & (areas.any(axis=2).sum(axis=0) == 1)
        pressures, known = np.zeros((len(forces), len(areas))), own.any(axis=1).all()
        for number, (area, some) in enumerate(zip(areas, own, strict=True)):
            if known:
                a, f = area[some], forces[:, :nodes][:, some]
                pressures[:, number] = np.median(-(f * a).sum(2) / (a * a).sum(1), axis=1)
        following = replace(of_units, amplitudes=pressures)
        dead = dead_part(geometry, forces, following)
        for some in own:
            loaded = dead[:, :nodes][:, some].any(axis=2).sum(axis=1)
            known = known and (2 * loaded < some.sum()).all()
        if not known:
            raise InputError("the pressures of the samples cannot be told from their other forces")
        return cls(dead, following)

    @classmethod
    def _of_actuators(cls, geometry: Geometry, forces: Array) -> Load:
        """Tell tensions and pressures from all forces, of which there are no others."""
        units = FollowingLoads.of(geometry, np.eye(len(geometry.following)))
        nodes, flat = len(geometry.coordinates), forces.reshape(len(forces), -1)
        rows = (units.load[:, :nodes] * geometry.free).reshape(len(units.amplitudes), -1)
        found = np.asarray(flat[:, : rows.shape[1]] @ np.linalg.pinv(rows), np.float64)
        left = np.linalg.norm(flat[:, : rows.shape[1]] - found @ rows, axis=1)
        if (left > FAINT * np.linalg.norm(flat, axis=1)).any():
            raise InputError("the actuators of the samples cannot be told from their other forces")
        return cls(np.zeros_like(forces), replace(units, amplitudes=found))

    def __getitem__(self, cases: int | slice) -> Load:
        """One of N load cases, or some."""
        some = slice(cases, cases + 1) if isinstance(cases, int) else cases
        return Load(self.dead[cases], None if self.following is None else self.following[some])

    @property
    def cases(self) -> Load:
        """All load cases, with N before; one as N = 1."""
        return replace(self, dead=self.dead.reshape(-1, *self.dead.shape[-2:]))

    def at_rest(self, geometry: Geometry) -> Array:
        """Nodal forces in N, (n_nodes, d) or with N before, with pressures undeformed."""
        nodal = self.dead[..., : len(geometry.coordinates), :]
        if self.following is None:
            return nodal
        pushed = self.following.load[:, : nodal.shape[-2]] * geometry.free
        return np.asarray(nodal + pushed.reshape(nodal.shape))

    def part(self, share: float) -> Load:
        """A part of the load."""
        following = None if self.following is None else self.following.scaled(share)
        return Load(share * self.dead, following)


def fields_at_nodes(geometry: Geometry, values: ArrayLike | Tensor, name: str) -> Array:
    """Return nodal fields in double precision, (n_nodes, d) or (N, n_nodes, d).

    Raises
    ------
    InputError
        If they are no array of real numbers, or have another shape.
    """
    fields = real_numbers(values, name)
    expected = geometry.coordinates.shape
    if fields.ndim not in (2, 3) or fields.shape[-2:] != expected:
        raise InputError(f"{name} have shape {fields.shape}, expected {expected} or (N, *)")
    return fields


def checked_loads(geometry: Geometry, forces: ArrayLike | Tensor) -> Array:
    """Return a load in N in double precision, (n_nodes, d) or (N, n_nodes, d).

    It may have n_points rows instead, of elements with points between the nodes: the forces there
    after the nodal ones.

    Raises
    ------
    InputError
        If they are no real numbers, the shape is wrong, a force is not finite, or one acts on a
        held component.
    """
    points, loads = geometry.loaded_points, real_numbers(forces, "forces")
    if points is not None and loads.ndim in (2, 3) and loads.shape[-2] == points.count:
        nodal = fields_at_nodes(geometry, loads[..., : points.nodes, :], "forces")
        between = loads[..., points.nodes :, :]
        if not np.abs(between).max(initial=0.0) < LARGEST_FORCE:
            raise InputError("forces hold a NaN or an infinity, expected finite numbers in N")
    else:
        nodal, between = fields_at_nodes(geometry, loads, "forces"), None
    least, most = nodal.min(initial=0.0), nodal.max(initial=0.0)
    if not (least > -LARGEST_FORCE and most < LARGEST_FORCE):  # true for NaN as well
        raise InputError("forces hold a NaN or an infinity, expected finite numbers in N")
    held = np.flatnonzero(geometry.held)  # degrees of freedom, node · d + component
    at_held = nodal.reshape(-1, geometry.held.size)[:, held]
    if at_held.any():
        node = held[at_held.any(axis=0)][0] // nodal.shape[-1]
        how = "clamped" if geometry.clamped[node] else "held in this component"
        raise InputError(f"forces at node {node}: the node is {how}, expected a free one")
    return nodal if between is None else loads


def checked_load(geometry: Geometry, forces: ArrayLike | Tensor) -> Array:
    """Return one load, (n_nodes or n_points, d) in N; InputError as `checked_loads`."""
    load = checked_loads(geometry, forces)
    if load.ndim != 2:
        raise InputError(f"forces have shape {load.shape}, expected {load.shape[1:]}")
    return load


def checked_pressure(
    geometry: Geometry, pressure: ArrayLike | None, forces: Array
) -> FollowingLoads | None:
    """Return the pressures that are a part of a load, (n_nodes, d) or (N, n_nodes, d).

    Parameters
    ----------
    geometry : Geometry
    pressure : array, (n,) or (N, n), or None
        Of `Geometry.following`, in Pa, N of cables; a number if there is one. None if none is.

    Raises
    ------
    InputError
        If it is missing, its shape is wrong, or a number is not finite.
    """
    units = geometry.following
    if pressure is None and units:
        raise InputError(
            "pressure is missing: the loads of the case have one that follows the surface, "
            "expected its value in Pa beside the forces, 0 if forces act alone"
        )
    if pressure is None:
        return None
    if not units:
        raise InputError("pressure: the case has none, expected forces only")
    values = real_numbers(pressure, "pressure")
    cases = len(forces) if forces.ndim == 3 else 1
    if values.ndim < 2 and values.size == len(units):
        values = np.broadcast_to(values.reshape(1, -1), (cases, len(units)))
    if values.shape != (cases, len(units)) or not np.isfinite(values).all():
        raise InputError(
            f"pressure has shape {np.shape(pressure)}, expected {len(units)} finite "
            f"{'number' if len(units) == 1 else 'numbers'} in Pa (N of cables) for each load case"
        )
    return FollowingLoads.of(geometry, values)


def actuated_amplitudes(geometry: Geometry, actuate: Mapping[str, float] | Sequence[str]) -> Array:
    """Amplitudes of `Geometry.following`, (n,) in Pa or N: those of the actuators that are named.

    Raises
    ------
    InputError
        If there is no such actuator, or a length, a volume or an amount of gas is given.
    """
    placed, amplitudes = geometry.actuators, np.zeros(len(geometry.following))
    texts = [f"{k}={v}" for k, v in actuate.items()] if isinstance(actuate, Mapping) else actuate
    if placed is None:
        if len(texts):
            raise InputError(f"--actuate '{texts[0]}': the case has no actuators")
        return amplitudes
    for name, control in zip(placed.names, placed.given(texts), strict=True):
        if not control.gives_amplitude:
            raise InputError(
                f"--actuate '{name}': expected a tension or a pressure, not the {control.kind}"
            )
        amplitudes[len(geometry.surfaces) + placed.names.index(name)] = control.value
    return amplitudes


def dead_part(geometry: Geometry, forces: Array, following: FollowingLoads | None) -> Array:
    """A load in N without the forces of pressures on the undeformed body, of the same shape.

    Where it does not say what acts between the nodes, that is the pressures alone. Differences that
    are rounding of single precision are zero.
    """
    if following is None:
        return forces
    rows = forces.shape[-2]
    of_pressures = following.load[:, :rows]
    beside = ((0, 0), (0, rows - of_pressures.shape[1]), (0, 0))
    at_rest = np.pad(of_pressures, beside).reshape(forces.shape)
    dead = (forces - at_rest) * geometry.free_at_points[:rows]
    size = np.linalg.norm(at_rest, axis=-1, keepdims=True)
    return np.where(np.abs(dead) <= ROUNDING * size, 0.0, dead)


def given_load(
    geometry: Geometry,
    load: GivenLoad,
    nearest: bool = False,
    body_force: str | Sequence[float] | None = None,
    needed: bool = True,
) -> CommandLoads:
    """Return a load as forces and pressures on the body.

    Parameters
    ----------
    geometry : Geometry
    load : array (n_nodes or n_points, d), Tensor, str, Path or sequence of str and Path
        A load in N; or texts, and files of forces
        (`shared_schema.common.bodies.command_loads`).
    nearest : bool
        Let forces at other places act at the nearest node.
    body_force : str or sequence of d floats, optional
        A force in N per m³ that acts everywhere as well.
    needed : bool
        No load at all is an error.

    Raises
    ------
    InputError
        If the load is wrong, or has a pressure though the case has none.
    """
    body = geometry.loaded_body
    parts = [load] if isinstance(load, str | Path) else load
    if isinstance(parts, list | tuple) and all(isinstance(part, str | Path) for part in parts):
        texts = [part for part in parts if isinstance(part, str)]
        files = [part for part in parts if isinstance(part, Path)]
        if not parts and body_force is None and not needed:
            return CommandLoads(body)
        given = command_loads(body, texts, files, nearest=nearest, body_force=body_force)
        if given.surfaces and geometry.pressed is None:
            raise InputError(
                "load: a pressure, expected forces; the body's case has no family 'pressure'",
                "load",
            )
        return given
    given = CommandLoads(body)
    both = checked_load(geometry, load)  # type: ignore[arg-type]  # no texts are left
    given.forces, between = both[: len(body.coordinates)], both[len(body.coordinates) :]
    given.between[: len(between)] = between
    if body_force is not None:
        given.add_body_force(body_force)
    return given
