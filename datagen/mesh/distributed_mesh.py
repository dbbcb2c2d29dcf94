"""Meshes distributed by dolfinx over MPI ranks, with the node numbers of their source kept."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from typing import Any

import dolfinx
import numpy as np
from mpi4py import MPI
from numpy.typing import NDArray

from datagen.dolfinx_versions import create_mesh
from datagen.mesh.geometries import Geometry
from datagen.ranks import on_rank_zero
from shared_schema.common.bodies.cells import conformity_problem
from shared_schema.common.bodies.groups import RawMesh
from shared_schema.common.errors import InputError


@dataclass(frozen=True)
class Mesh(RawMesh):
    """A mesh in two forms: distributed by dolfinx, and as whole arrays, the same on every rank.

    Attributes
    ----------
    domain : dolfinx.mesh.Mesh
        Distributed over the ranks of its communicator.
    """

    domain: Any = field(kw_only=True)

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
        On every rank, if the cells have a `conformity_problem`: dolfinx would damage its memory; or
        if a rank gets no cell.
    """
    problem = conformity_problem(raw.coordinates, raw.cells, raw.cell_type)
    if problem is not None:
        raise InputError(f"mesh: {problem}")
    cell = UFL_NAMES[raw.cell_type]
    to_dolfinx = dolfinx.cpp.io.perm_vtk(dolfinx.cpp.mesh.to_type(cell), raw.cells.shape[1])
    here = slice(None) if comm.rank == 0 else slice(0)  # rank 0 hands in all cells and nodes
    domain = create_mesh(comm, raw.cells[here][:, to_dolfinx], cell, raw.coordinates[here])
    fewest = comm.allreduce(domain.topology.index_map(domain.topology.dim).size_local, op=MPI.MIN)
    if fewest == 0:
        raise InputError(
            f"mesh: {comm.size} ranks share its {len(raw.cells)} cells and one of them gets none, "
            "expected fewer ranks (--ranks-per-solve)"
        )
    whole = {field.name: getattr(raw, field.name) for field in fields(RawMesh)}
    return Mesh(**whole, domain=domain)
