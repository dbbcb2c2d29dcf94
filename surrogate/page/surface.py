"""What of a mesh is drawn: triangles, lines of the mesh, feature lines, supports, materials."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from shared_schema.common.bodies.cells import (
    FACETS,
    boundary_facets,
    edges_of,
    sharp_edges,
    smooth_pairs,
)
from shared_schema.common.errors import InputError
from surrogate.mechanics.body.geometry import Geometry

Integers = NDArray[np.int32]
GAP, TICK = 0.003, 0.028  # of the diagonal: a mark's distance from the body, and its width


@dataclass(frozen=True)
class Surface:
    """The drawn part of a body, by node numbers; in the plane it is the whole body.

    Attributes
    ----------
    vertices : array of int, (n_vertices,)
        Node of every vertex of the triangles; a node at a sharp edge has several, one for each of
        the smooth faces that meet there.
    triangles : array of int, (n_triangles, 3)
        Vertex numbers, seen from outside.
    lines : array of int, (n_lines, 2)
        Edges of the drawn cells or faces.
    features : array of int, (n_features, 2)
        Those of them that show the body's shape: the boundary, in space the sharp edges.
    supports : array of int, (n_supports, d)
        Boundary edges (in space: triangles) whose nodes are all held, in one component at least.
    seams : array of int, (n_seams, d)
        Edges (in space: triangles) between cells of two materials.
    """

    vertices: Integers
    triangles: Integers
    lines: Integers
    features: Integers
    supports: Integers
    seams: Integers


def surface_of(geometry: Geometry) -> Surface:
    """Find the drawn part of a body.

    Raises
    ------
    InputError
        If the mesh has no cells of a known type.
    """
    if geometry.cell_type not in FACETS or len(geometry.cells) == 0:
        raise InputError(
            f"page: the run's mesh has {len(geometry.cells)} cells of type "
            f"'{geometry.cell_type}', expected some of {', '.join(FACETS)}, for a surface"
        )
    facets = boundary_facets(geometry.cells, geometry.cell_type)
    faces = geometry.cells if geometry.dimension == 2 else facets
    around = np.sort(edges_of(faces), axis=1)
    pairs = smooth_pairs(geometry.coordinates, faces)
    vertices, corners = smooth_vertices(faces, around, pairs)
    lines = np.unique(around, axis=0)
    sharp = facets if geometry.dimension == 2 else sharp_edges(geometry.coordinates, faces)
    held = facets[np.any(geometry.held[facets].all(axis=1), axis=1)]
    return Surface(
        vertices=vertices.astype(np.int32),
        triangles=triangulated(corners).astype(np.int32),
        lines=lines.astype(np.int32),
        features=sharp.astype(np.int32),
        supports=(held if geometry.dimension == 2 else triangulated(held)).astype(np.int32),
        seams=seams_of(geometry).astype(np.int32),
    )


def seams_of(geometry: Geometry) -> NDArray[np.int64]:
    """Edges (in space: triangles) between cells of two materials: (n_seams, d)."""
    parts = np.zeros(len(geometry.cells), np.int64) if geometry.parts is None else geometry.parts
    bodies = [geometry.cells[parts == part] for part in np.unique(parts)]
    facets = np.concatenate([boundary_facets(body, geometry.cell_type) for body in bodies])
    _, first, count = np.unique(np.sort(facets), axis=0, return_index=True, return_counts=True)
    between = facets[first[count == 2]]
    return between if geometry.dimension == 2 else triangulated(between)


def support_marks(geometry: Geometry, supports: Integers) -> dict[str, NDArray[np.float64]]:
    """Marks of supports, seen from outside: hatched lines in the plane, faces with ticks in space.

    Returns
    -------
    dict
        In m: ``lines``, (n, 2, 3), and ``faces``, (n, 3, 3); where no part of the boundary is held,
        ``points``, (n, 3), that are.
    """
    x, d = geometry.coordinates, geometry.dimension
    tick = TICK * float(np.linalg.norm(np.ptp(x, axis=0)))
    x = np.pad(x, ((0, 0), (0, 3 - d)))
    corners = x[supports]
    along = corners[:, 1] - corners[:, 0]
    out = np.cross(along, [0, 0, 1] if d == 2 else corners[:, -1] - corners[:, 0])
    out /= np.linalg.norm(out, axis=1, keepdims=True)
    back = corners + GAP / TICK * tick * out[:, None]
    points = x[geometry.held.all(axis=1)] if len(supports) == 0 else x[:0]
    if d == 3:
        ticks = np.stack([back, back + 0.7 * tick * out[:, None]], axis=2)
        return {"lines": ticks.reshape(-1, 2, 3), "faces": back, "points": points}
    length = np.linalg.norm(along, axis=1, keepdims=True)
    counts = np.maximum(1, np.rint(length[:, 0] / (0.75 * tick))).astype(int)
    edge = np.repeat(np.arange(len(back)), counts)
    number = np.arange(len(edge)) - np.repeat(np.cumsum(counts) - counts, counts)
    start = back[edge, 0] + ((number + 0.5) / counts[edge])[:, None] * along[edge]
    slope = 0.8 * tick * (along / length + out)[edge]
    lines = np.concatenate([back, np.stack([start, start + slope], axis=1)])
    return {"lines": lines, "faces": np.empty((0, 3, 3)), "points": points}


def triangulated(faces: NDArray[np.int64]) -> NDArray[np.int64]:
    """Split quadrilaterals into two triangles each: (n, 3 or 4) → (n or 2n, 3)."""
    if faces.shape[1] == 3:
        return faces
    return faces[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3)


def smooth_vertices(
    faces: NDArray[np.int64], around: NDArray[np.int64], pairs: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Join the corners of faces that meet smoothly.

    Returns
    -------
    vertices : array of int, (n_vertices,)
        Node of every vertex.
    corners : array of int, (n_faces, n_corners)
        Vertices of every face.
    """
    size = faces.shape[1]
    place = np.arange(faces.size)
    ends = np.stack([place, place - place % size + (place + 1) % size], axis=1)  # of every edge
    ordered = np.where((faces.ravel()[ends[:, :1]] == around[:, :1]), ends, ends[:, ::-1])
    rows, columns = ordered[pairs[:, 0]].ravel(), ordered[pairs[:, 1]].ravel()
    joined = coo_array((np.ones(len(rows)), (rows, columns)), shape=(faces.size, faces.size))
    count, vertex = connected_components(joined, directed=False)
    vertices = np.empty(count, dtype=np.int64)
    vertices[vertex] = faces.ravel()
    return vertices, vertex.reshape(faces.shape)
