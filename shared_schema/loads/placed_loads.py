"""Load families placed on a mesh: the nodes of their regions, and the load cases that they draw."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from shared_schema.common.bodies.cells import boundary_facets
from shared_schema.common.bodies.groups import GroupParts, RawMesh, groups_of_sides
from shared_schema.common.bodies.points_between import PointsBetween
from shared_schema.common.errors import InputError
from shared_schema.loads.family import LoadableNodes, LoadFamily
from shared_schema.loads.regions import Region
from shared_schema.loads.together import LoadsTogether


def placed_loads(
    load: LoadFamily | tuple[LoadFamily, ...],
    seed: int,
    mesh: RawMesh,
    held: NDArray[np.bool_],
    points: PointsBetween | None = None,
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

    Raises
    ------
    InputError
        If a region holds no node, a loadable node is clamped, or a family does not fit the mesh.
    """
    several = isinstance(load, tuple)
    families = load if isinstance(load, tuple) else (load,)
    nodes = [
        _loadable(f"load.{number}.region" if several else "load.region", each, mesh, held, points)
        for number, each in enumerate(families)
    ]
    loads = LoadsTogether.of(families, seed, nodes, held)
    loads.check()
    return loads


def nodes_of(key: str, region: Region, mesh: RawMesh, of_sides: bool) -> NDArray[np.bool_]:
    """Nodes of a region, (n_nodes,); InputError that names the key of the region if it has none.

    A group may be one of sides only, where it is a support or a load on the surface.
    """
    try:
        needed = region.boundary or (region.nodes is not None and mesh.origins is not None)
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
    """Nodes of a family; InputError if some of a given region are clamped, for loads at nodes."""
    region = nodes_of(key, family.region, mesh, family.of_sides)
    clamped = held.all(axis=1)
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
