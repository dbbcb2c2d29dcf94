"""What a drawing needs of a mesh, and the faces and edges that can be seen of it."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from shared_schema.common.bodies.cells import FACETS, boundary_facets
from shared_schema.common.bodies.surface_edges import edges_of
from shared_schema.common.keys.units import SI, Units

Array = NDArray[np.float64]


class Mesh(Protocol):
    """The attributes of a mesh that a drawing needs."""

    @property
    def coordinates(self) -> Array:
        """Node positions of the undeformed body, (n_nodes, d) in m."""

    @property
    def cells(self) -> NDArray[np.int64]:
        """Node numbers of every cell, (n_cells, n_corners), VTK order."""

    @property
    def cell_type(self) -> str:
        """Name of the cells in meshio."""


def units_of(mesh: Mesh) -> Units:
    """Units that a drawing of a mesh names: its attribute `units`, or metres and newtons."""
    units = getattr(mesh, "units", SI)
    return units if isinstance(units, Units) else SI


def surface_faces(mesh: Mesh) -> NDArray[np.int64]:
    """Faces that can be seen: the cells of a plane mesh, the boundary faces of one in space.

    Returns
    -------
    array of int, (n_faces, n_corners)
        Node numbers, going round each face.
    """
    if mesh.coordinates.shape[1] == 2:
        return mesh.cells
    return boundary_facets(mesh.cells, mesh.cell_type)


def cells_of_faces(mesh: Mesh, faces: NDArray[np.int64]) -> NDArray[np.int64]:
    """Find the cell that each of the faces belongs to, (n_faces,); plane faces are the cells."""
    kinds = FACETS[mesh.cell_type] if mesh.coordinates.shape[1] == 3 else [slice(None)]
    every = np.concatenate([mesh.cells[:, kind] for kind in kinds])
    rows = np.sort(np.concatenate([every, faces]), axis=1)
    _, number = np.unique(rows, axis=0, return_inverse=True)
    number = number.ravel()
    cell_of = np.zeros(number.max() + 1, dtype=np.int64)
    cell_of[number[: len(every)]] = np.tile(np.arange(len(mesh.cells)), len(kinds))
    return np.asarray(cell_of[number[len(every) :]])


def surface_edges(mesh: Mesh) -> NDArray[np.int64]:
    """Edges of the surface's faces, each once: (n_edges, 2) node numbers."""
    return each_once(edges_of(surface_faces(mesh)))


def each_once(edges: NDArray[np.int64]) -> NDArray[np.int64]:
    """Edges, lower node number first, each once: (n_edges, 2)."""
    return np.unique(np.sort(edges, axis=1), axis=0)
