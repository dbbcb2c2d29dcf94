"""Meshes distributed by dolfinx over MPI ranks, with the node numbers of their source kept."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import dolfinx
import numpy as np
from mpi4py import MPI
from numpy.typing import NDArray

from datagen.dolfinx_versions import create_mesh
from datagen.mesh.geometries import Geometry
from datagen.mesh.raw_mesh import RawMesh
from datagen.ranks import on_rank_zero
from shared_schema.common.bodies.conformity import conformity_problem
from shared_schema.common.errors import InputError


@dataclass(frozen=True)
class Mesh:
    """A mesh in two forms: distributed by dolfinx, and as the whole arrays of the dataset.

    Attributes
    ----------
    domain : dolfinx.mesh.Mesh
        Distributed over the ranks of its communicator.
    coordinates : array, (n_nodes, d)
        All nodes by node number, in m; the same on every rank.
    cells : array of int, (n_cells, n_corners)
        Node numbers of every cell, in VTK order; the same on every rank.
    cell_type : str
        meshio's name: quad, triangle, hexahedron or tetra.
    groups : mapping of str to array of int
        Node numbers of every named group; the same on every rank.
    cell_groups : mapping of str to array of int
        Cell numbers of every named group of cells; the same on every rank.
    """

    domain: Any
    coordinates: NDArray[np.float64]
    cells: NDArray[np.int64]
    cell_type: str
    groups: Mapping[str, NDArray[np.int64]] = field(default_factory=dict)
    cell_groups: Mapping[str, NDArray[np.int64]] = field(default_factory=dict)

    @property
    def node_sets(self) -> dict[str, NDArray[np.bool_]]:
        """Nodes of every named group, (n_nodes,) each."""
        sets = {}
        for name, members in self.groups.items():
            sets[name] = np.zeros(len(self.coordinates), dtype=bool)
            sets[name][members] = True
        return sets

    def of_local_cells(self, values: NDArray[Any]) -> NDArray[Any]:
        """Values of the cells of this rank, ghosts included, from those of all cells."""
        return values[np.asarray(self.domain.topology.original_cell_index)]


UFL_NAMES = {
    "quad": "quadrilateral",
    "triangle": "triangle",
    "hexahedron": "hexahedron",
    "tetra": "tetrahedron",
}


def make_mesh(geometry: Geometry, comm: MPI.Comm) -> Mesh:
    """Read or generate a mesh on rank 0 of `comm` and distribute it over the ranks (collective).

    Parameters
    ----------
    geometry : Geometry
        Geometry or mesh file of the case.
    comm : mpi4py communicator
        The ranks that share the mesh.

    Raises
    ------
    InputError
        On every rank, if a mesh file cannot be read or its mesh is unfit.
    """
    return distributed(on_rank_zero(comm, geometry.raw_mesh), comm)


def distributed(raw: RawMesh, comm: MPI.Comm) -> Mesh:
    """Distribute a mesh over the ranks of `comm`, all of which hold its arrays (collective).

    Raises
    ------
    InputError
        On every rank, if the cells have a `conformity_problem`: dolfinx would damage its memory.
    """
    problem = conformity_problem(raw.coordinates, raw.cells, raw.cell_type)
    if problem is not None:
        raise InputError(f"mesh: {problem}")
    cell = UFL_NAMES[raw.cell_type]
    to_dolfinx = dolfinx.cpp.io.perm_vtk(dolfinx.cpp.mesh.to_type(cell), raw.cells.shape[1])
    here = slice(None) if comm.rank == 0 else slice(0)  # rank 0 hands in all cells and nodes
    domain = create_mesh(comm, raw.cells[here][:, to_dolfinx], cell, raw.coordinates[here])
    return Mesh(domain, raw.coordinates, raw.cells, raw.cell_type, raw.groups, raw.cell_groups)
