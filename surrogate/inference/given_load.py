"""The load of a prediction, as nodal forces: given as such, or in the words of a command line."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray
from torch import Tensor

from shared_schema.common.arguments.real_numbers import real_numbers
from shared_schema.common.bodies.command_loads import CommandLoads, command_loads
from shared_schema.common.bodies.facet_quadrature import area_vectors
from shared_schema.common.errors import InputError
from surrogate.data.geometry import Geometry
from surrogate.mechanics.follower_pressure import FollowerPressure

ROUNDING = 1e-6  # of a force in single precision, and more
LARGEST_FORCE = float(np.finfo(np.float32).max)
Array = NDArray[np.float64]
Load: TypeAlias = ArrayLike | Tensor | str | Path | Sequence[str | Path]


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


def checked_forces(geometry: Geometry, forces: ArrayLike | Tensor) -> Array:
    """Return nodal forces in N in double precision, (n_nodes, d) or (N, n_nodes, d).

    Raises
    ------
    InputError
        If they are no real numbers, the shape is wrong, a force is not finite, or one acts on a
        held component.
    """
    nodal = fields_at_nodes(geometry, forces, "forces")
    least, most = nodal.min(initial=0.0), nodal.max(initial=0.0)
    if not (least > -LARGEST_FORCE and most < LARGEST_FORCE):  # true for NaN as well
        raise InputError("forces hold a NaN or an infinity, expected finite numbers in N")
    held = np.flatnonzero(geometry.held)  # degrees of freedom, node · d + component
    at_held = nodal.reshape(-1, geometry.held.size)[:, held]
    if at_held.any():
        node = held[at_held.any(axis=0)][0] // nodal.shape[-1]
        how = "clamped" if geometry.clamped[node] else "held in this component"
        raise InputError(f"forces at node {node}: the node is {how}, expected a free one")
    return nodal


def checked_force(geometry: Geometry, forces: ArrayLike | Tensor) -> Array:
    """Return the nodal forces of one load case, (n_nodes, d) in N; InputError as above."""
    nodal = checked_forces(geometry, forces)
    if nodal.ndim != 2:
        raise InputError(f"forces have shape {nodal.shape}, expected {nodal.shape[1:]}")
    return nodal


def checked_pressure(
    geometry: Geometry, pressure: ArrayLike | None, forces: Array
) -> FollowerPressure | None:
    """Return the pressures that are a part of nodal forces, (n_nodes, d) or (N, n_nodes, d).

    Parameters
    ----------
    geometry : Geometry
    pressure : array, (n_surfaces,) or (N, n_surfaces), or None
        In Pa; a number if there is one surface. None for a body without such surfaces.

    Raises
    ------
    InputError
        If it is missing, its shape is wrong, or a number is not finite.
    """
    surfaces = geometry.surfaces
    if pressure is None and surfaces:
        raise InputError(
            "pressure is missing: the loads of the case have one that follows the surface, "
            "expected its value in Pa beside the forces, 0 if forces act alone"
        )
    if pressure is None:
        return None
    if not surfaces:
        raise InputError("pressure: the case has none, expected forces only")
    values = real_numbers(pressure, "pressure")
    cases = len(forces) if forces.ndim == 3 else 1
    if values.ndim < 2 and values.size == len(surfaces):
        values = np.broadcast_to(values.reshape(1, -1), (cases, len(surfaces)))
    if values.shape != (cases, len(surfaces)) or not np.isfinite(values).all():
        raise InputError(
            f"pressure has shape {np.shape(pressure)}, expected {len(surfaces)} finite "
            f"{'number' if len(surfaces) == 1 else 'numbers'} in Pa for each load case"
        )
    return FollowerPressure(geometry.coordinates, surfaces, values)


def dead_part(geometry: Geometry, forces: Array, pressure: FollowerPressure | None) -> Array:
    """Forces in N without those of pressures on the undeformed body, of the same shape.

    Differences that are rounding of single precision are zero.
    """
    if pressure is None:
        return forces
    at_rest = pressure.at_rest.reshape(forces.shape)
    dead = (forces - at_rest) * geometry.free
    return np.where(np.abs(dead) <= ROUNDING * np.abs(at_rest), 0.0, dead)


def without_pressure(
    geometry: Geometry, forces: Array, pressure: ArrayLike | None
) -> tuple[Array, FollowerPressure | None]:
    """Tell given pressures from the dead forces beside them: `checked_pressure`, `dead_part`."""
    follows = checked_pressure(geometry, pressure, forces)
    return dead_part(geometry, forces, follows), follows


def separated(geometry: Geometry, forces: Array) -> tuple[Array, FollowerPressure | None]:
    """Tell the pressures of samples from their dead forces, which a dataset holds as one sum.

    The pressure of a surface is the median of those that explain the force of each of its nodes. It
    is exact if fewer than half of these have another force.

    Parameters
    ----------
    geometry : Geometry
    forces : array, (N, n_nodes, d)
        Nodal forces in N, with those of pressures on the undeformed body.

    Returns
    -------
    dead : array, (N, n_nodes, d)
        In N.
    pressure : FollowerPressure or None
        None for a body without such surfaces.

    Raises
    ------
    InputError
        If another force acts on half of the nodes, or no node belongs to one surface alone.
    """
    if not geometry.surfaces:
        return forces, None
    areas = np.stack([area_vectors(geometry.coordinates, s) for s in geometry.surfaces])
    areas *= geometry.free
    own = areas.any(axis=2) & (areas.any(axis=2).sum(axis=0) == 1)
    pressures, known = np.zeros((len(forces), len(areas))), own.any(axis=1).all()
    for number, (area, nodes) in enumerate(zip(areas, own, strict=True)):
        if known:
            a, f = area[nodes], forces[:, nodes]
            pressures[:, number] = np.median(-(f * a).sum(2) / (a * a).sum(1), axis=1)
    pressure = FollowerPressure(geometry.coordinates, geometry.surfaces, pressures)
    dead = dead_part(geometry, forces, pressure)
    for nodes in own:
        known = known and (2 * dead[:, nodes].any(axis=2).sum(axis=1) < nodes.sum()).all()
    if not known:
        raise InputError("the pressures of the samples cannot be told from their other forces")
    return dead, pressure


def following(given: CommandLoads) -> FollowerPressure | None:
    """Pressures of a load as those of one load case; None if it has none."""
    if not given.surfaces:
        return None
    pressures = np.array([given.pressures])
    return FollowerPressure(given.body.coordinates, tuple(given.surfaces), pressures)


def given_load(
    geometry: Geometry,
    load: Load,
    nearest: bool = False,
    body_force: str | Sequence[float] | None = None,
    needed: bool = True,
) -> CommandLoads:
    """Return a load as forces and pressures on the body.

    Parameters
    ----------
    geometry : Geometry
    load : array (n_nodes, d), Tensor, str, Path or sequence of str and Path
        Nodal forces in N; or texts as ``--load`` takes them, and files as ``--forces`` does
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
        If the load is wrong, or has a pressure that the body's training had none of.
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
                "--load: a pressure, expected forces; the network was trained on these"
            )
        return given
    given = CommandLoads(body)
    given.forces = checked_force(geometry, load)  # type: ignore[arg-type]  # no texts are left
    if body_force is not None:
        given.add_body_force(body_force)
    return given
