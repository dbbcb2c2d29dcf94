"""The body of a case: its mesh, clamped nodes, loadable nodes, and equilibrium problem."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from datagen.cases.case import Case
from datagen.loads import DrawnLoads, LoadableNodes
from datagen.mesh.distributed_mesh import Mesh, make_mesh
from datagen.mesh.regions import Region
from datagen.solver.equilibrium import EquilibriumProblem
from datagen.solver.locking import locking_warning
from shared_schema.cells import boundary_facets
from shared_schema.common.errors import InputError


@dataclass(frozen=True)
class Body:
    """Mesh of a case with its supports, loadable nodes and equilibrium problem.

    Attributes
    ----------
    case : Case
    mesh : Mesh
    clamped : array of bool, (n_nodes,)
        True for clamped nodes, by node number.
    loadable : array of bool, (n_nodes,)
        True for nodes that the load family may load, by node number.
    loads : DrawnLoads
        The load cases, by their sample number.
    problem : EquilibriumProblem
        Built once; distributed over the ranks of the communicator that the body was made with.
    """

    case: Case
    mesh: Mesh
    clamped: NDArray[np.bool_]
    loadable: NDArray[np.bool_]
    loads: DrawnLoads
    problem: EquilibriumProblem

    def warning(self) -> str | None:
        """What the numbers of this body are not good for, if there is something."""
        material = self.case.material
        return locking_warning(self.case.element, self.mesh.cell_type, material.poisson_ratio)

    def shard_arrays(self) -> dict[str, Any]:
        """Arrays of the mesh that every shard holds, by their paths in the schema."""
        return {
            "mesh/coordinates": self.mesh.coordinates,
            "mesh/cells": self.mesh.cells,
            "mesh/clamped": self.clamped,
            "mesh/loadable": self.loadable,
        }


def make_body(case: Case, comm: Any) -> Body:
    """Mesh the case's geometry on the ranks of `comm` and build its problem (collective).

    Raises
    ------
    InputError
        On every rank, if meshing or reading fails, a region holds no node, a loadable node is
        clamped, the load family does not fit the mesh, or a part of the mesh is not supported.
    """
    try:
        mesh = make_mesh(case.mesh, comm)
    except InputError as error:
        raise InputError(f"case '{case.name}': {error}") from None
    clamped = np.zeros(len(mesh.coordinates), dtype=bool)
    for number, region in enumerate(case.supports):
        clamped |= _select(case, f"supports.{number}", region, mesh)
    loadable = _select(case, "load.region", case.load.region, mesh)
    if (loadable & clamped).any():
        at = ",".join(f"{value:g}" for value in mesh.coordinates[loadable & clamped][0])
        raise InputError(
            f"case '{case.name}': key 'load.region' holds the clamped node at {at}, "
            "expected free nodes only"
        )
    loose = loose_nodes(mesh, clamped)
    if loose.size:
        at = ",".join(f"{value:g}" for value in mesh.coordinates[loose[0]])
        raise InputError(
            f"case '{case.name}': key 'supports': {loose.size} nodes are not connected to a "
            f"clamped one, the first at {at}"
        )
    nodes = LoadableNodes(np.flatnonzero(loadable), mesh.coordinates, mesh.cells, mesh.cell_type)
    loads = DrawnLoads(case.load, case.dataset.seed, nodes)
    try:
        loads.check()
    except InputError as error:
        raise InputError(f"case '{case.name}': {error}") from None
    problem = EquilibriumProblem(mesh, case.material, clamped, case.solver, case.element)
    return Body(case, mesh, clamped, loadable, loads, problem)


def _select(case: Case, key: str, region: Region, mesh: Mesh) -> NDArray[np.bool_]:
    """Nodes of a region, (n_nodes,); InputError that names the key of the region if it has none."""
    try:
        facets = boundary_facets(mesh.cells, mesh.cell_type) if region.boundary else None
        nodes = region.select(mesh.coordinates, mesh.groups, facets)
    except ValueError as error:
        raise InputError(f"case '{case.name}': key '{key}': {error}") from None
    if not nodes.any():
        raise InputError(f"case '{case.name}': key '{key}': no node of the mesh lies there")
    return nodes


def loose_nodes(mesh: Mesh, clamped: NDArray[np.bool_]) -> NDArray[np.intp]:
    """Find the nodes from which no path of cells leads to a clamped node.

    Parameters
    ----------
    mesh : Mesh
    clamped : array of bool, (n_nodes,)

    Returns
    -------
    array of int, (n_loose,)
        Node numbers, ascending.
    """
    first = np.repeat(mesh.cells[:, 0], mesh.cells.shape[1])
    count = len(mesh.coordinates)
    edges = coo_array((np.ones(first.size), (first, mesh.cells.ravel())), shape=(count, count))
    _, part = connected_components(edges, directed=False)
    return np.flatnonzero(~np.isin(part, part[clamped]))
