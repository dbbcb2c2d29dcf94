r"""The load that a command is given: ``--load``, ``--forces``, ``--body-force``, and ``--hold``.

===========================  ======================================================================
text                         meaning
===========================  ======================================================================
``X,Y[,Z]:FX,FY[,FZ]``       a force in N at the node there, or at the nearest one (``--nearest``)
``X,Y[,Z],R:FX,FY[,FZ]``     a force in N that is spread smoothly over the surface within R m of the
                             place (`shared_schema.common.bodies.distributed_loads`)
``GROUP:FX,FY[,FZ]``         a force in N on a named group of the mesh, distributed as a uniform
                             body force over its cells if it consists of cells, as a uniform
                             traction over its facets if it consists of these, or equally over its
                             nodes if it has neither
``GROUP:P``                  a pressure in Pa on the facets of the group, which follows the surface
``BX,BY[,BZ]``               with ``--body-force``: a force in N per m³ of the undeformed body,
                             everywhere
``X,Y[,Z]:UX,UY[,UZ]``       with ``--hold``: a displacement in m of the node there, or at the
``GROUP:UX,UY[,UZ]``         nearest one, or of all nodes of a group; ``-`` leaves a component free
===========================  ======================================================================

A file of forces is a solution (``.npz`` with `coordinates`, `force` and maybe `force_between`), or
text (``.csv``) with lines X,Y[,Z],FX,FY[,FZ]. All that acts on one node adds up. What would act on
a held component of a group or a patch is borne by the supports; what acts on a component with a
given displacement, by what holds it.

On quadratic elements, what is distributed over cells or facets acts on the points between the nodes
as well (`shared_schema.common.bodies.points_between`). A force at a node acts at the
corner of cells, and so does what is distributed over the nodes of a group.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from numpy.typing import NDArray

from shared_schema.common.arguments import real_numbers, require_type
from shared_schema.common.bodies.cells import boundary_facets, outward_facets
from shared_schema.common.bodies.distributed_loads import (
    SurfacePatches,
    facet_shares,
    nodal_volumes,
    pressure_forces,
)
from shared_schema.common.bodies.groups import GroupParts, cells_in, facets_in
from shared_schema.common.bodies.nodal_forces import RELATIVE_TOLERANCE, nodal_forces, node_at
from shared_schema.common.bodies.points_between import PointsBetween
from shared_schema.common.errors import InputError
from shared_schema.common.files import text_lines
from shared_schema.common.solution_file import read_field, read_forces_between

if TYPE_CHECKING:
    from shared_schema.common.bodies.following_loads import PressedSurface

Array = NDArray[np.float64]
Loads: TypeAlias = str | Sequence[str] | Array
MOST = 1e12  # N or Pa in magnitude


@dataclass(frozen=True)
class LoadedBody:
    """What a load is given for.

    Attributes
    ----------
    coordinates : array, (n_nodes, d)
        In m.
    cells : array of int, (n_cells, n_corners)
    cell_type : str
    held : array of bool, (n_nodes, d)
        Components that supports hold.
    groups : mapping of str to array of bool, (n_nodes,)
        Nodes of the named groups.
    points : PointsBetween, optional
        Points of quadratic elements; None if the nodes are all.
    parts : mapping of str to GroupParts
        Facets and cells of the groups whose nodes do not tell them.
    """

    coordinates: Array
    cells: NDArray[np.int64]
    cell_type: str
    held: NDArray[np.bool_]
    groups: Mapping[str, NDArray[np.bool_]]
    points: PointsBetween | None = None
    parts: Mapping[str, GroupParts] = field(default_factory=dict)

    @cached_property
    def positions(self) -> Array:
        """Positions of all points, (n_points, d) in m."""
        x = self.coordinates
        return x if self.points is None else self.points.interpolated(x)

    @property
    def clamped(self) -> NDArray[np.bool_]:
        """Nodes that do not move at all, (n_nodes,)."""
        return np.asarray(self.held.all(axis=1))

    def facets_of(self, group: str) -> NDArray[np.int64]:
        """Facets of a group on the surface, seen from outside."""
        facets = outward_facets(self.coordinates, self.cells, self.cell_type)
        return facets_in(facets, self.groups[group], self.parts.get(group))


@dataclass
class CommandLoads:
    """Loads that act together.

    Attributes
    ----------
    body : LoadedBody
    forces : array, (n_nodes, d)
        Dead forces at the nodes in N.
    between : array, (n_between, d)
        Dead forces between the nodes in N; (0, d) if the body has no points there.
    surfaces : list of array of int, (n_facets, n_points of a facet)
        Facets under pressure, by the numbers of all their points.
    pressures : list of float
        Pressure on each of them in Pa.
    moved : array of bool, (n_nodes, d)
        Components whose displacement is prescribed.
    displacement : array, (n_nodes, d)
        Prescribed displacements in m, else 0.
    notes : list of str
        Nodes that loads were moved to.
    actuation : array, (n_points, d), or None
        Forces that actuators would have on the undeformed body, in N.
    """

    body: LoadedBody
    forces: Array = field(init=False)
    between: Array = field(init=False)
    surfaces: list[NDArray[np.int64]] = field(default_factory=list)
    pressures: list[float] = field(default_factory=list)
    moved: NDArray[np.bool_] = field(init=False)
    displacement: Array = field(init=False)
    notes: list[str] = field(default_factory=list)
    actuation: Array | None = None

    def __post_init__(self) -> None:
        self.forces = np.zeros(self.body.coordinates.shape)
        self.displacement = np.zeros(self.body.coordinates.shape)
        self.moved = np.zeros(self.body.coordinates.shape, dtype=bool)
        self.between = np.zeros_like(self.body.positions[len(self.forces) :])

    @property
    def following(self) -> tuple[PressedSurface, ...]:
        """The pressures as loads that follow the body."""
        from shared_schema.common.bodies.following_loads import PressedSurface

        return tuple(map(PressedSurface, self.surfaces))

    @property
    def forces_between(self) -> Array | None:
        """Dead forces between the nodes, (n_between, d) in N; None if no point is there."""
        return None if self.body.points is None else self.between

    @property
    def load(self) -> Array:
        """All dead forces in N, those between the nodes after those at them: (n_points, d)."""
        return np.concatenate([self.forces, self.between])

    @property
    def at_rest(self) -> Array:
        """Forces at the nodes, with those of pressures and actuators on the undeformed body.

        They are (n_nodes, d) in N.
        """
        return self._with_pressures()[0]

    @property
    def at_rest_between(self) -> Array | None:
        """The same between the nodes: (n_between, d) in N, or None."""
        return None if self.body.points is None else self._with_pressures()[1]

    def _with_pressures(self) -> tuple[Array, Array]:
        at_rest = self.pushed(np.zeros(self.body.positions.shape))
        at_rest += 0.0 if self.actuation is None else self.actuation
        pushed, between = self._parts(at_rest)
        return np.where(self.body.held, 0.0, self.forces) + pushed, self.between + between

    def pushed(self, displacement: Array) -> Array:
        """Forces of the pressures on the deformed body: (n_points, d) in m → same in N."""
        total = np.zeros(displacement.shape)
        for facets, pressure in zip(self.surfaces, self.pressures, strict=True):
            total += pressure_forces(self.body.positions + displacement, facets, pressure)
        return total

    def _parts(self, forces: Array) -> tuple[Array, Array]:
        """Forces at the nodes and between them by those on all points, none of them on held ones.

        From (n_points, d) to (n_nodes, d) and (n_between, d), in N.
        """
        points, held = self.body.points, self.body.held
        if points is None:
            return np.where(held, 0.0, forces), self.between[:0]
        between = np.where(points.held(held), 0.0, forces)[points.nodes :]
        return np.where(held, 0.0, points.on_nodes(forces)), between

    def _distribute(self, shares: Array, total: Sequence[float], option: str) -> None:
        """Add a force of which every point takes a share, (n_points,), unless all are held."""
        forces, between = self._parts(np.outer(shares, total))
        if np.any(total) and not (forces.any() or between.any()):
            raise InputError(f"{option}: all of it acts on supports, expected a part on free nodes")
        self.forces += forces
        self.between += between

    def scale(self, factor: float) -> None:
        """Multiply all forces and pressures."""
        self.forces *= factor
        self.between *= factor
        self.pressures = [factor * pressure for pressure in self.pressures]

    def add(self, text: str, nearest: bool = False) -> None:
        """Add what ``--load`` says.

        Raises
        ------
        InputError
            If the text is malformed, there is no such group or node, or the node is held.
        """
        name, _, values = text.rpartition(":")
        d = self.body.coordinates.shape[1]
        if name not in self.body.groups and _is_position(name, d + 1):
            self._add_patch(text, name, values)
            return
        if name not in self.body.groups:
            if self.body.groups and not _is_position(name, d):
                names = ", ".join(sorted(self.body.groups))
                raise InputError(f"--load '{text}': no such group, the mesh has {names}")
            coordinates, clamped = self.body.coordinates, self.body.clamped
            forces = nodal_forces([text], coordinates, clamped, nearest, self.notes)
            self._require_free(forces, f"--load '{text}'")
            self.forces += forces
            return
        numbers = _numbers(values, f"--load '{text}'", f"{d} numbers (N), or one (Pa)", (1, d))
        if len(numbers) == 1:
            facets = self.body.facets_of(name)
            if not len(facets):
                raise InputError(f"--load '{text}': the group has no facet to press on")
            if self.body.clamped[facets].all():
                raise InputError(f"--load '{text}': all of it acts on supports")
            self.surfaces.append(self._all_points(facets))
            self.pressures.append(numbers[0])
            return
        self._distribute(self._shares(name), numbers, f"--load '{text}'")

    def _add_patch(self, text: str, place: str, values: str) -> None:
        """Add a force that is spread over a part of the surface."""
        body, option = self.body, f"--load '{text}'"
        d = body.coordinates.shape[1]
        *centre, radius = _numbers(place, option, "a place and a radius in m", (d + 1,))
        place, force = "X,Y,Z"[: 2 * d - 1], "FX,FY,FZ"[: 3 * d - 1]
        numbers = _numbers(values, option, f"{place}:{force}, or {place},R:{force}", (d,))
        if not radius > 0:
            raise InputError(f"{option}: a radius of {radius:g}, expected one above 0 m")
        facets = self._all_points(boundary_facets(body.cells, body.cell_type))
        surface = SurfacePatches.of(body.positions, facets)
        weights = surface.weights(np.array(centre), radius)
        if not weights.any():
            raise InputError(f"{option}: no part of the surface lies within {radius:g} m of it")
        self._distribute(weights / weights.sum(), numbers, option)

    def add_body_force(self, density: str | Sequence[float]) -> None:
        """Add a force in N per m³ everywhere; what acts on held components the supports bear.

        Raises
        ------
        InputError
            If it is not d finite numbers.
        """
        d = self.body.coordinates.shape[1]
        text = density if isinstance(density, str) else ",".join(map(str, density))
        numbers = _numbers(text, f"--body-force '{text}'", f"{d} numbers (N/m³)", (d,))
        cells = self.body.cells if self.body.points is None else self.body.points.cells
        self._distribute(nodal_volumes(self.body.positions, cells), numbers, "--body-force")

    def add_forces(self, forces: Array) -> None:
        """Add nodal forces, (n_nodes, d) in N; InputError if they are none, or one is held."""
        forces = real_numbers(forces, "nodal forces")
        if not np.isfinite(forces).all():
            raise InputError("nodal forces hold a NaN or an infinity, expected finite numbers in N")
        if forces.shape != self.forces.shape:
            raise InputError(f"load of shape {forces.shape}: expected {self.forces.shape}")
        self._require_free(forces, "load")
        self.forces += forces

    def add_file(self, path: Path, nearest: bool = False) -> None:
        """Add the forces of a file; InputError that names the file, and the line of a ``.csv``."""
        if path.suffix == ".npz":
            forces = _solution_forces(path, self.body.coordinates)
            self._add_between(path)
        elif path.suffix == ".csv":
            forces = self._csv_forces(path, nearest)
        else:
            raise InputError(f"--forces '{path}': expected a file name ending in .npz, .csv")
        self._require_free(forces, f"--forces '{path}'")
        self.forces += forces

    def _add_between(self, path: Path) -> None:
        """Add the forces between the nodes of a solution, if it has some and the body has points.

        Linear elements take the forces at the nodes alone, which do the same work in them.
        """
        points = self.body.points
        between = None
        if points is not None:
            between = read_forces_between(path, self.between.shape, "--forces")
        if points is None or between is None:
            return
        if not np.abs(between).max(initial=0.0) <= MOST:
            raise InputError(f"--forces '{path}': expected finite forces, at most {MOST:g} N")
        self.between += np.where(points.held(self.body.held)[points.nodes :], 0.0, between)

    def move(self, text: str, nearest: bool = False) -> None:
        """Add what ``--hold`` says; InputError if it is wrong, or a component is held or moved."""
        name, _, values = text.rpartition(":")
        d, option = self.body.coordinates.shape[1], f"--hold '{text}'"
        members = self.members(name, option, nearest)
        parts = [part.strip() for part in values.split(",")]
        components = np.array([part != "-" for part in parts])
        numbers = ",".join("0" if part == "-" else part for part in parts)
        wanted = _numbers(numbers, option, f"{d} numbers (m), or - for a free component", (d,))
        moved = members[:, None] & components
        if not moved.any():
            raise InputError(f"{option}: expected a displacement of one component at least")
        if (moved & (self.body.held | self.moved)).any():
            raise InputError(f"{option}: a node is held or moved already")
        self.moved |= moved
        self.displacement += moved * np.array(wanted)

    def members(self, name: str, option: str, nearest: bool) -> NDArray[np.bool_]:
        """Nodes of a group, or the one at a place, (n_nodes,)."""
        x, d = self.body.coordinates, self.body.coordinates.shape[1]
        if name in self.body.groups:
            return self.body.groups[name]
        if not _is_position(name, d):
            names = ", ".join(sorted(self.body.groups)) or "none"
            raise InputError(
                f"{option}: expected X,Y:UX,UY or GROUP:UX,UY, the groups of the mesh are {names}"
            )
        place = np.array(_numbers(name, option, f"{d} numbers (m)", (d,)))
        members = np.zeros(len(x), dtype=bool)
        members[node_at(place, option, x, self.body.clamped, nearest, self.notes)] = True
        return members

    def _shares(self, name: str) -> Array:
        """Part of the force on a group that each point takes, (n_points,), of sum 1."""
        x, points, members = self.body.positions, self.body.points, self.body.groups[name]
        inside = cells_in(self.body.cells, members, self.body.parts.get(name))
        cells, facets = self.body.cells[inside], self.body.facets_of(name)
        shares = np.zeros(len(x))
        if _are(members, cells):
            shares = nodal_volumes(x, cells if points is None else points.cells[inside])
        elif _are(members, facets):
            facets = self._all_points(facets)
            np.add.at(shares, facets, facet_shares(x[facets]))
        elif len(cells) or len(facets):
            raise InputError(
                f"--load: group '{name}' has nodes beside its cells and facets, expected cells, "
                "facets of the surface, or nodes alone"
            )
        else:
            shares[: len(members)][members] = 1.0
        return shares / shares.sum()

    def _all_points(self, facets: NDArray[np.int64]) -> NDArray[np.int64]:
        """Facets by the numbers of all their points, by those of their corners."""
        return facets if self.body.points is None else self.body.points.facets(facets)

    def _csv_forces(self, path: Path, nearest: bool) -> Array:
        d = self.body.coordinates.shape[1]
        expected = "X,Y,FX,FY" if d == 2 else "X,Y,Z,FX,FY,FZ"
        lines = text_lines(path, "--forces")
        texts = []
        for number, line in enumerate(lines, 1):
            if not line.strip() or line.startswith("#") or (number == 1 and _is_words(line)):
                continue  # a line of names may stand first
            where = f"--forces '{path}': line {number}"
            values = [f"{value!r}" for value in _numbers(line, where, expected, (2 * d,))]
            texts.append(f"{','.join(values[:d])}:{','.join(values[d:])}")
        try:
            coordinates, clamped = self.body.coordinates, self.body.clamped
            return nodal_forces(texts, coordinates, clamped, nearest, self.notes)
        except InputError as error:
            raise InputError(f"--forces '{path}': {str(error).removeprefix('--load ')}") from None

    def _require_free(self, forces: Array, source: str) -> None:
        """Raise InputError if a force acts on a held component."""
        wrong = np.argwhere(self.body.held & (forces != 0))
        if len(wrong):
            node, axis = wrong[0]
            at = ",".join(f"{value:g}" for value in self.body.coordinates[node])
            raise InputError(f"{source}: the node at {at} is held in {'xyz'[axis]}")


def command_loads(
    body: LoadedBody,
    loads: Loads,
    files: Sequence[Path] = (),
    moves: Sequence[str] = (),
    nearest: bool = False,
    body_force: str | Sequence[float] | None = None,
    needed: bool = True,
) -> CommandLoads:
    """Collect the loads of a command, or of a call.

    Parameters
    ----------
    body : LoadedBody
    loads : str, sequence of str, or array (n_nodes, d)
        Texts of ``--load``, or nodal forces in N.
    files, moves
        Files of ``--forces``, texts of ``--hold``.
    nearest : bool
        Let a force beside a node act at the nearest one.
    body_force : str or sequence of d floats, optional
        What ``--body-force`` says, in N/m³.
    needed : bool
        There has to be one.

    Raises
    ------
    InputError
        If one is wrong, or there is none at all.
    """
    given, texts = CommandLoads(body), [loads] if isinstance(loads, str) else loads
    if not isinstance(texts, np.ndarray):
        require_type("load", texts, Sequence[str])
        if needed and len(texts) + len(files) + len(moves) == 0 and body_force is None:
            raise InputError("no load, expected --load, --forces or --body-force")
        for text in texts:
            given.add(text, nearest)
    else:
        given.add_forces(texts)
    for path in files:
        given.add_file(path, nearest)
    if body_force is not None:
        given.add_body_force(body_force)
    for text in moves:
        given.move(text, nearest)
    if not np.abs(given.forces).max() <= MOST:
        raise InputError(f"a force component is beyond {MOST:g} N")
    return given


def _are(members: NDArray[np.bool_], parts: NDArray[np.int64]) -> bool:
    """True if the nodes of a group are those of some cells or facets of it."""
    return len(parts) > 0 and bool(np.isin(np.flatnonzero(members), parts).all())


def _is_position(text: str, count: int) -> bool:
    try:
        return len([float(part) for part in text.split(",")]) == count
    except ValueError:
        return False


def _is_words(line: str) -> bool:
    return not any(_is_position(part, 1) for part in line.split(","))


def _numbers(text: str, option: str, expected: str, counts: tuple[int, ...]) -> list[float]:
    """Read finite numbers separated by commas; InputError unless there are so many."""
    try:
        numbers = [float(part) for part in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) not in counts:
        raise InputError(f"{option}: expected {expected}")
    if not np.all(np.abs(numbers) <= MOST):  # true for NaN as well
        raise InputError(f"{option}: expected finite numbers, at most {MOST:g}")
    return numbers


def _solution_forces(path: Path, coordinates: Array) -> Array:
    """Read the forces of a solution on the same mesh."""
    forces = read_field(path, "force", coordinates, "--forces", RELATIVE_TOLERANCE)
    if not np.abs(forces).max() <= MOST:
        raise InputError(f"--forces '{path}': expected finite forces, at most {MOST:g} N")
    return forces
