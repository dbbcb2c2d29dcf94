"""What of a mesh is drawn: triangles, lines of the mesh, feature lines, supports."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shared_schema.cells import FACETS, boundary_facets
from shared_schema.common.errors import InputError
from surrogate.data.geometry import Geometry

SHARP = np.cos(np.radians(30))  # a line of the surface with a larger angle is a feature
Integers = NDArray[np.int32]


@dataclass(frozen=True)
class Surface:
    """The drawn part of a body, by node numbers; in the plane it is the whole body.

    Attributes
    ----------
    triangles : array of int, (n_triangles, 3)
        Seen from outside.
    lines : array of int, (n_lines, 2)
        Edges of the drawn cells or faces.
    features : array of int, (n_features, 2)
        Those of them that show the body's shape: the boundary, in space the sharp edges.
    supports : array of int, (n_supports, d)
        Boundary edges (in space: triangles) whose nodes are all clamped.
    """

    triangles: Integers
    lines: Integers
    features: Integers
    supports: Integers


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
    lines = np.unique(np.sort(edges(faces), axis=1), axis=0)
    held = facets[geometry.clamped[facets].all(axis=1)]
    return Surface(
        triangles=triangulated(faces).astype(np.int32),
        lines=lines.astype(np.int32),
        features=features(geometry, facets).astype(np.int32),
        supports=(held if geometry.dimension == 2 else triangulated(held)).astype(np.int32),
    )


def edges(faces: NDArray[np.int64]) -> NDArray[np.int64]:
    """Edges of all faces, going round each of them: (n, corners) → (n · corners, 2)."""
    return np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2)


def triangulated(faces: NDArray[np.int64]) -> NDArray[np.int64]:
    """Split quadrilaterals into two triangles each: (n, 3 or 4) → (n or 2n, 3)."""
    if faces.shape[1] == 3:
        return faces
    return faces[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3)


def features(geometry: Geometry, facets: NDArray[np.int64]) -> NDArray[np.int64]:
    """Boundary edges in the plane; in space edges between facets at an angle above 30°."""
    if geometry.dimension == 2:
        return facets
    around, corners = np.sort(edges(facets), axis=1), facets.shape[1]
    x = geometry.coordinates[facets]
    normal = np.cross(x[:, 1] - x[:, 0], x[:, -1] - x[:, 0])
    normal = normal / np.linalg.norm(normal, axis=1, keepdims=True)
    found, number = np.unique(around, axis=0, return_inverse=True)
    owner = np.repeat(np.arange(len(facets)), corners)
    order = np.argsort(number.ravel(), kind="stable")
    starts = np.searchsorted(number.ravel()[order], np.arange(len(found)))
    first = owner[order[starts]]
    last = owner[order[np.append(starts[1:], len(order)) - 1]]
    smooth = np.einsum("ij,ij->i", normal[first], normal[last]) > SHARP
    return found[~smooth | (first == last)]
