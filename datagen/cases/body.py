"""The body of a case: its mesh, which nodes are clamped, which may be loaded."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from datagen.cases.case import Case
from datagen.loads import LoadableNodes
from datagen.mesh.distributed_mesh import Mesh, make_mesh
from datagen.mesh.regions import Region
from datagen.solver.equilibrium import EquilibriumProblem
from shared_schema.common.errors import InputError


@dataclass(frozen=True)
class Body:
    """A case's mesh with its supports and loadable nodes, and the problem built on it once.

    Attributes
    ----------
    mesh : Mesh
    clamped : array of bool, (n_nodes,)
    loadable : array of bool, (n_nodes,)
    loadable_nodes : LoadableNodes
        The same nodes by their numbers, for the load family.
    problem : EquilibriumProblem
        Lives on the ranks of the communicator that the body was made with.
    """

    mesh: Mesh
    clamped: NDArray[np.bool_]
    loadable: NDArray[np.bool_]
    loadable_nodes: LoadableNodes
    problem: EquilibriumProblem

    def shard_arrays(self) -> dict[str, Any]:
        """What every shard says of the mesh, by the schema's paths."""
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
        On every rank, if the mesh cannot be had, a region holds no node, a loadable node is
        clamped, or a part of the mesh is not held.
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
    try:
        case.load.check(nodes)
    except ValueError as error:
        raise InputError(f"case '{case.name}': load family: {error}") from None
    problem = EquilibriumProblem(mesh, case.material, clamped, case.solver)
    return Body(mesh, clamped, loadable, nodes, problem)


def _select(case: Case, key: str, region: Region, mesh: Mesh) -> NDArray[np.bool_]:
    """The nodes of a region; InputError, naming its key, if there are none."""
    try:
        nodes = region.select(mesh.coordinates, mesh.groups)
    except ValueError as error:
        raise InputError(f"case '{case.name}': key '{key}': {error}") from None
    if not nodes.any():
        raise InputError(f"case '{case.name}': key '{key}': no node of the mesh lies there")
    return nodes


def loose_nodes(mesh: Mesh, clamped: NDArray[np.bool_]) -> NDArray[np.intp]:
    """Numbers of the nodes in parts of the mesh that no clamped node holds."""
    first = np.repeat(mesh.cells[:, 0], mesh.cells.shape[1])
    count = len(mesh.coordinates)
    edges = coo_array((np.ones(first.size), (first, mesh.cells.ravel())), shape=(count, count))
    _, part = connected_components(edges, directed=False)
    return np.flatnonzero(~np.isin(part, part[clamped]))
