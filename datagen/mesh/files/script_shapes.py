r"""One mesh for all shapes of a gmsh script: where its nodes are as its constants change.

The script is meshed once. In the geometry that it draws with other constants, a node of a point or
curve is at the same share of that curve. Nodes of a surface in space are moved with the curves
around and then go to the closest place of the surface. All others follow: their displacement is
harmonic, on the graph of the mesh's edges with weights :math:`1 / |x_i - x_j|^2`. Where the script
makes the same cells for all shapes, as transfinite ones do, its own meshes are taken.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csc_array, diags
from scipy.sparse.linalg import splu

from datagen.mesh.files.gmsh_file import mesh_by_gmsh
from datagen.mesh.gmsh_model import generate, gmsh_session, mesh_of
from shared_schema.common.bodies.cells import boundary_facets
from shared_schema.common.bodies.groups import RawMesh

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Constants = Mapping[str, float]
OF_SHAPES = "parameters: "  # before what is wrong with their ranges


@dataclass(frozen=True)
class MeshedEntity:
    """A point, curve or surface of a geometry with its nodes.

    Attributes
    ----------
    dimension, tag : int
        As gmsh has them.
    nodes : array of int, (n,)
        Numbers of the nodes inside of it.
    share : array, (n, dimension)
        Parameters of each node, from 0 to 1 over the bounds of the entity.
    """

    dimension: int
    tag: int
    nodes: Ints
    share: Array


def positions_of_shapes(path: Path, reference: Constants, shapes: Sequence[Constants]) -> Array:
    """Positions of the nodes of the reference's mesh in some shapes, (n_shapes, n_nodes, d) in m.

    Raises
    ------
    ValueError
        If gmsh draws a geometry of other points, curves and surfaces for one of them.
    """
    with gmsh_session(reference) as gmsh:
        gmsh.open(str(path))
        generate(gmsh, gmsh.model.getDimension())
        mesh, parts = mesh_of(gmsh.model), _parts(gmsh.model)
        entities = _meshed(gmsh.model, mesh)
    own = _own_meshes(path, mesh, shapes)
    if own is not None:
        return own
    found = np.repeat(mesh.coordinates[None], len(shapes), axis=0)
    for x, constants in zip(found, shapes, strict=True):
        with gmsh_session(constants) as gmsh:
            gmsh.open(str(path))
            if _parts(gmsh.model) != parts:
                moved = [f"{n} = {v:g}" for n, v in constants.items() if v != reference[n]]
                raise ValueError(
                    f"{OF_SHAPES}{', '.join(moved)}: the geometry has other points, curves or "
                    "surfaces than in the middle of the ranges, expected narrower ones"
                )
            _move_surface(gmsh.model, mesh, entities, x)
    known = np.unique(np.concatenate([entity.nodes for entity in entities]))
    return mesh.coordinates + harmonic(mesh, mesh.cells, known, found - mesh.coordinates)


def _own_meshes(path: Path, mesh: RawMesh, shapes: Sequence[Constants]) -> Array | None:
    """Positions of the script's own meshes; None if the cells of one are others."""
    found = []
    for constants in shapes:
        try:
            other = mesh_by_gmsh(path, constants)
        except ValueError:
            return None
        if not np.array_equal(other.cells, mesh.cells):
            return None
        found.append(other.coordinates)
    return np.array(found)


def _parts(model: Any) -> list[tuple[Any, ...]]:
    """What bounds each entity of a geometry."""
    return [
        (entity, *model.getBoundary([entity], oriented=False)) for entity in model.getEntities()
    ]


def _meshed(model: Any, mesh: RawMesh) -> list[MeshedEntity]:
    """Points, curves and (in space) surfaces with the nodes inside of them."""
    assert mesh.places is not None
    tags = np.sort(model.mesh.getNodes()[0]).astype(np.int64)
    places, first = mesh.places, 1 if tags[0] > 0 else 0
    found = []
    for dimension, tag in model.getEntities():
        if dimension >= mesh.coordinates.shape[1]:
            continue
        nodes, _, parameters = model.mesh.getNodes(dimension, tag, returnParametricCoord=True)
        numbers = np.searchsorted(places, nodes.astype(np.int64) - first)
        used = np.isin(nodes.astype(np.int64) - first, places)
        low, high = _bounds(model, dimension, tag)
        share = (parameters.reshape(len(nodes), dimension) - low) / (high - low)
        found.append(MeshedEntity(dimension, tag, numbers[used], share[used]))
    return found


def _bounds(model: Any, dimension: int, tag: int) -> tuple[Array, Array]:
    """Lowest and highest parameters of an entity, (dimension,) each."""
    low, high = model.getParametrizationBounds(dimension, tag)
    return np.array(low), np.array(high)


def _move_surface(model: Any, mesh: RawMesh, entities: Sequence[MeshedEntity], x: Array) -> None:
    """Put the nodes of points, curves and surfaces where they are in another geometry."""
    d = x.shape[1]
    for entity in (each for each in entities if each.dimension < 2 and len(each.nodes)):
        low, high = _bounds(model, entity.dimension, entity.tag)
        at = (low + entity.share * (high - low)).ravel()
        places = model.getValue(entity.dimension, entity.tag, at)
        x[entity.nodes] = np.reshape(places, (-1, 3))[:, :d]
    surfaces = [each for each in entities if each.dimension == 2 and len(each.nodes)]
    if not surfaces:
        return
    inside = np.unique(np.concatenate([entity.nodes for entity in surfaces]))
    every = np.unique(np.concatenate([entity.nodes for entity in entities]))
    facets = boundary_facets(mesh.cells, mesh.cell_type)
    known = np.setdiff1d(every, inside)
    x[:] = mesh.coordinates + harmonic(mesh, facets, known, (x - mesh.coordinates)[None])[0]
    for entity in surfaces:
        closest, _ = model.getClosestPoint(2, entity.tag, x[entity.nodes].ravel())
        x[entity.nodes] = np.reshape(closest, (-1, 3))


def harmonic(mesh: RawMesh, cells: Ints, known: Ints, displacements: Array) -> Array:
    """Extend displacements from the known nodes of cells or facets to their other nodes.

    Parameters
    ----------
    mesh : RawMesh
    cells : array of int, (n_cells, n_corners)
    known : array of int, (n_known,)
        Numbers of nodes whose displacement is known.
    displacements : array, (n_fields, n_nodes, d)
        In m; those of other nodes than the known ones are replaced.
    """
    x, count, corners = mesh.coordinates, len(mesh.coordinates), cells.shape[1]
    pairs = np.stack([np.repeat(cells, corners, axis=1).ravel(), np.tile(cells, corners).ravel()])
    pairs = np.unique(pairs[:, pairs[0] != pairs[1]], axis=1)
    weights = 1 / np.square(x[pairs[0]] - x[pairs[1]]).sum(axis=1)
    graph = coo_array((weights, tuple(pairs)), shape=(count, count)).tocsc()
    free = np.setdiff1d(np.unique(cells), known)
    if not len(free):
        return displacements
    laplacian = csc_array(diags(np.asarray(graph.sum(axis=1)).ravel()) - graph)
    fields = displacements.transpose(1, 0, 2).reshape(count, -1).copy()
    fields[free] = splu(csc_array(laplacian[free][:, free])).solve(
        graph[free][:, known] @ fields[known]
    )
    return fields.reshape(count, *displacements.shape[::2]).transpose(1, 0, 2)
