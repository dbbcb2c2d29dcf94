"""The load cases of a dataset: one or several families, placed on the nodes of their regions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from shared_schema.actuators import Actuator, Control, PlacedActuators, placed_actuators, pressed
from shared_schema.common.bodies.cells import boundary_facets
from shared_schema.common.bodies.command_loads import LoadedBody
from shared_schema.common.bodies.following_loads import PressedSurface
from shared_schema.common.bodies.groups import GroupParts, RawMesh, groups_of_sides
from shared_schema.common.bodies.nodal_forces import scatter_forces, sum_per_node
from shared_schema.common.bodies.points_between import PointsBetween
from shared_schema.common.errors import InputError
from shared_schema.common.units import LARGEST_SEED
from shared_schema.loads.drawn_load import DrawnLoads
from shared_schema.loads.family import LoadableNodes, LoadFamily
from shared_schema.loads.regions import Region
from shared_schema.tools import Sphere

Array = NDArray[np.float64]
Recorded = tuple[NDArray[np.int64], Array, Array | None]  # nodes, forces there, and between them


@dataclass(frozen=True)
class Load:
    """All that acts on the body in one load case.

    Attributes
    ----------
    nodes : array of int, (n_loads,)
        Nodes under dead forces, each once.
    forces : array, (n_loads, d)
        Dead force at each of them in N; zero in components that are held or moved.
    pressures : array, (n_surfaces,)
        Pressure on each surface in Pa.
    displacement : array, (n_nodes, d), or None
        Prescribed displacements in m; 0 where none is prescribed.
    tool : Sphere or None
        Rigid ball that the body keeps out of.
    between : array, (n_between, d), or None
        Dead forces between the nodes of quadratic elements in N; zero where all corners around a
        point are held or moved. None if no family loads them.
    actuation : tuple of Control
        What is given of each actuator.
    """

    nodes: NDArray[np.int64]
    forces: Array
    pressures: Array
    displacement: Array | None = None
    tool: Sphere | None = None
    between: Array | None = None
    actuation: tuple[Control, ...] = ()

    @property
    def controls(self) -> tuple[Control, ...]:
        """What is given of each following load: pressures on surfaces, then actuators."""
        return (*pressed(self.pressures), *self.actuation)

    @property
    def is_dead(self) -> bool:
        """True if the load consists of dead forces only."""
        moves = self.displacement is not None or self.tool is not None
        return not moves and not self.pressures.any() and not self.actuation


@dataclass(frozen=True)
class LoadsTogether:
    """The load cases of a dataset by their sample number.

    Attributes
    ----------
    parts : tuple of DrawnLoads
        One a family. The first draws with the dataset's seed, the others with seeds of their own.
    seed : int
        Seed of the dataset.
    body : LoadedBody
    actuators : PlacedActuators
    """

    parts: tuple[DrawnLoads, ...]
    seed: int
    body: LoadedBody
    actuators: PlacedActuators

    @classmethod
    def of(
        cls,
        families: Sequence[LoadFamily],
        seed: int,
        nodes: Sequence[LoadableNodes],
        body: LoadedBody,
        actuators: PlacedActuators,
    ) -> LoadsTogether:
        """Pair the families with their nodes."""
        pairs = enumerate(zip(families, nodes, strict=True))
        parts = tuple(DrawnLoads(f, _seed(seed, i), n) for i, (f, n) in pairs)
        return cls(parts, seed, body, actuators)

    @property
    def held(self) -> NDArray[np.bool_]:
        """Components that supports hold, (n_nodes, d)."""
        return self.body.held

    @property
    def loadable(self) -> LoadableNodes:
        """Nodes of the first family."""
        return self.parts[0].loadable

    @property
    def positions(self) -> Array:
        """Positions of all points of the elements, (n_points, d) in m."""
        return self.body.positions

    @property
    def points(self) -> PointsBetween | None:
        """All points of the elements; None if the nodes are all."""
        return self.body.points

    @cached_property
    def is_between(self) -> bool:
        """True if a load acts on points between the nodes, or prescribes their displacement."""
        families = [part.family for part in self.parts]
        acts = act_between(families, self.held.shape[1]) or len(self.actuators) > 0
        return self.points is not None and acts

    @cached_property
    def pressed(self) -> tuple[NDArray[np.int64], ...]:
        """Facets of every surface under pressure by their corners, (n_facets, n_corners) each."""
        return tuple(part.loadable.facets for part in self.parts if part.family.presses)

    @cached_property
    def surfaces(self) -> tuple[NDArray[np.int64], ...]:
        """The same facets by all their points, (n_facets, n_points of a facet) each."""
        points = self.points
        return tuple(f if points is None else points.facets(f) for f in self.pressed)

    @cached_property
    def following(self) -> tuple[PressedSurface, ...]:
        """The same as loads that follow the body."""
        return tuple(map(PressedSurface, self.surfaces))

    @cached_property
    def moved(self) -> NDArray[np.bool_]:
        """Components whose displacement is prescribed by a load, (n_nodes, d)."""
        moved = np.zeros_like(self.held)
        for part in self.parts:
            moved[part.loadable.nodes] |= part.family.moves(part.loadable.dimension)
        return moved & ~self.held

    @cached_property
    def most(self) -> int:
        """Largest number of loaded nodes of a sample; InputError if a family says none."""
        of_families = sum(part.most for part in self.parts)
        return min(of_families + int(self.actuated.sum()), len(self.held))

    @cached_property
    def actuated(self) -> NDArray[np.bool_]:
        """Nodes on which actuators act in the undeformed body, without held ones, (n_nodes,)."""
        total = np.zeros(self.held.shape, dtype=bool)
        for load in self.actuators.loads:
            forces = load.forces(self.positions)
            total |= (forces if self.points is None else self.points.on_nodes(forces)) != 0
        return np.asarray((total & ~self.held).any(axis=1))

    def on(self, coordinates: Array) -> LoadsTogether:
        """The same loads on a body of another shape, by its node positions, (n_nodes, d) in m."""
        moved = [
            replace(part, loadable=replace(part.loadable, coordinates=coordinates))
            for part in self.parts
        ]
        body = replace(self.body, coordinates=coordinates)
        return replace(
            self, parts=tuple(moved), body=body, actuators=self.actuators.on(body.positions)
        )

    def check(self) -> None:
        """Raise InputError unless every family fits the mesh, and no two drive the same nodes."""
        for part in self.parts:
            part.check()
        movers = [part for part in self.parts if any(part.family.moves(self.held.shape[1]))]
        nodes = np.concatenate([np.empty(0, dtype=int), *(part.loadable.nodes for part in movers)])
        if len(np.unique(nodes)) != len(nodes):
            raise InputError("key 'load': two families prescribe the displacement of one node")
        if sum(part.family.touches for part in self.parts) > 1:
            raise InputError("key 'load': two families with a tool, expected one at most")

    def __getitem__(self, number: int) -> Load:
        """Draw the load of one sample; InputError as `DrawnLoads` raises it."""
        drawn = [part[number] for part in self.parts]
        nodes, forces = np.empty(0, dtype=np.int64), np.empty((0, self.held.shape[1]))
        if len(drawn) == 1:
            nodes, forces = drawn[0].nodes, drawn[0].forces
        elif drawn:
            nodes, forces = sum_per_node(
                np.concatenate([each.nodes for each in drawn]),
                np.concatenate([each.forces for each in drawn]),
            )
        fixed = self.held | self.moved
        if fixed[nodes].any():
            forces = np.where(fixed[nodes], 0.0, forces)
            loaded = forces.any(axis=1)
            nodes, forces = nodes[loaded], forces[loaded]
        pressures = np.array([each.pressure for each in drawn if each.pressure is not None])
        displacement = None
        if self.moved.any():
            displacement = np.zeros(self.held.shape)
            for part, each in zip(self.parts, drawn, strict=True):
                if each.displacement is not None:
                    displacement[part.loadable.nodes] = each.displacement
            displacement[~self.moved] = 0.0
        tool = next((each.tool for each in drawn if each.tool is not None), None)
        between = [each.between for each in drawn if each.between is not None]
        acting = None
        if between and self.points is not None:
            known = self.points.held(fixed)[self.points.nodes :]
            acting = np.where(known, 0.0, np.sum(between, axis=0))
        actuation = self.actuators.controls(self.actuators.draw(number, self.seed))
        return Load(nodes, forces, pressures, displacement, tool, acting, actuation)

    def recorded(
        self,
        load: Load,
        grip: Array,
        pushes: Array | float = 0.0,
        amplitudes: Array | None = None,
    ) -> Recorded:
        """Forces that stand for a load in a dataset.

        They are the dead forces, the forces of pressures and actuators on the undeformed body,
        those that hold prescribed displacements, and the forces of the tool. None acts on a held
        component.

        Parameters
        ----------
        load : Load
        grip : array, (n_points, d)
            Forces that hold the prescribed displacements in equilibrium, in N.
        pushes : array, (n_nodes, d)
            Forces of the tool in N.
        amplitudes : array, (n_actuators,), optional
            Pressures and tensions of the actuators in equilibrium; 0 where none is given.

        Returns
        -------
        nodes : array of int, (n_loads,)
        forces : array, (n_loads, d)
            At the nodes in N.
        between : array, (n_between, d), or None
            Between the nodes in N.
        """
        if load.is_dead:
            return load.nodes, load.forces, load.between
        points, driven = self.points, grip.copy()
        for surface, pressure in zip(self.following, load.pressures, strict=True):
            driven += pressure * surface.forces(self.positions)
        if amplitudes is not None:
            driven += self.actuators.forces_at_rest(amplitudes, self.positions)
        total = scatter_forces(load.nodes, load.forces, len(self.held)) + pushes
        between = None
        if points is None:
            total += driven
        else:
            total += points.on_nodes(driven)
            between = np.where(points.held(self.held), 0.0, driven)[points.nodes :]
            between += 0.0 if load.between is None else load.between
        total[self.held] = 0.0
        nodes = np.flatnonzero(total.any(axis=1))
        return nodes, total[nodes], between


def act_between(families: Sequence[LoadFamily], dimension: int) -> bool:
    """True if a family loads points between nodes, should they be, or prescribes displacements."""
    return any(family.acts_between or any(family.moves(dimension)) for family in families)


def _seed(seed: int, part: int) -> int:
    """Seed of the family at a position; the first has the dataset's."""
    if part == 0:
        return seed
    state = np.random.SeedSequence([seed, part]).generate_state(1, np.uint64)[0]
    return int(state) & LARGEST_SEED


def placed_loads(
    load: LoadFamily | tuple[LoadFamily, ...],
    seed: int,
    mesh: RawMesh,
    held: NDArray[np.bool_],
    points: PointsBetween | None = None,
    actuators: Mapping[str, Actuator] = MappingProxyType({}),
) -> LoadsTogether:
    """Place the load of a case on its mesh.

    Parameters
    ----------
    load : LoadFamily, or tuple of some
        As the case has them.
    seed : int
        Seed of the dataset.
    mesh : RawMesh
    held : array of bool, (n_nodes, d)
        Components that supports hold.
    points : PointsBetween, optional
        All points of the elements; by default the nodes are all.
    actuators : mapping of str to Actuator
        Those of the case.

    Raises
    ------
    InputError
        If a region holds no node, a loadable node is clamped, or a family or an
        actuator does not fit the mesh.
    """
    several = isinstance(load, tuple)
    families = load if isinstance(load, tuple) else (load,)
    nodes = [
        _loadable(f"load.{number}.region" if several else "load.region", each, mesh, held, points)
        for number, each in enumerate(families)
    ]
    known = mesh.coordinates, mesh.cells, mesh.cell_type
    body = LoadedBody(*known, held, mesh.node_sets, points, mesh.parts)
    loads = LoadsTogether.of(families, seed, nodes, body, placed_actuators(actuators, body))
    loads.check()
    return loads


def nodes_of(key: str, region: Region, mesh: RawMesh, of_sides: bool) -> NDArray[np.bool_]:
    """Nodes of a region, (n_nodes,); InputError that names the key of the region if it has none.

    A group may be one of sides only, where it is a support or a load on the surface.
    """
    try:
        needed = region.boundary or region.patch is not None
        needed |= region.nodes is not None and mesh.origins is not None
        facets = boundary_facets(mesh.cells, mesh.cell_type) if needed else None
        groups, origins = _groups(mesh, of_sides), mesh.origins
        nodes = region.select(
            mesh.coordinates, groups, facets, mesh.places, origins, mesh.counted_from
        )
    except ValueError as error:
        raise InputError(f"key '{key}': {error}") from None
    if not nodes.any():
        raise InputError(f"key '{key}': no node of the mesh lies there")
    return nodes


def _loadable(
    key: str,
    family: LoadFamily,
    mesh: RawMesh,
    held: NDArray[np.bool_],
    points: PointsBetween | None,
) -> LoadableNodes:
    """Nodes of a family; InputError if some of a given region are clamped, for loads at nodes.

    A region of the surface (`boundary`) leaves clamped nodes out.
    """
    region = nodes_of(key, family.region, mesh, family.of_sides)
    clamped = held.all(axis=1)
    if family.region.boundary and (region & ~clamped).any():
        region = region & ~clamped
    may_touch = family.integrates or family.is_everywhere
    if (region & clamped).any() and not (may_touch and (region & ~clamped).any()):
        at = ",".join(f"{value:g}" for value in mesh.coordinates[region & clamped][0])
        raise InputError(f"key '{key}' holds the clamped node at {at}, expected free nodes only")
    return LoadableNodes(
        np.flatnonzero(region & ~clamped),
        mesh.coordinates,
        mesh.cells,
        mesh.cell_type,
        np.flatnonzero(region),
        np.flatnonzero(clamped),
        points,
        _parts_of(mesh, family.region.group, family.of_sides),
    )


def _parts_of(mesh: RawMesh, group: str | None, of_sides: bool) -> GroupParts | None:
    """Facets and cells of a group that a region names; None where its nodes tell them."""
    if group is None:
        return None
    members = _groups(mesh, of_sides)[group]
    return next((mesh.parts.get(name) for name, m in mesh.groups.items() if m is members), None)


def _groups(mesh: RawMesh, of_sides: bool) -> Mapping[str, NDArray[np.int64]]:
    dimension = mesh.coordinates.shape[1]
    return groups_of_sides(mesh.groups, dimension) if of_sides else mesh.groups
