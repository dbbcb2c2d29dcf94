"""The body of a case: its mesh, which nodes are clamped, which may be loaded."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from datagen.case import Case
from datagen.equilibrium import EquilibriumProblem
from datagen.loads import LoadableNodes
from datagen.meshing import Mesh, make_mesh
from shared_schema.errors import InputError


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
        On every rank, if no node is clamped, none is loadable, or a loadable one is clamped.
    """
    mesh = make_mesh(case.mesh, comm)
    clamped = np.zeros(len(mesh.coordinates), dtype=bool)
    for region in case.supports:
        clamped |= region.select(mesh.coordinates)
    loadable = case.load.region.select(mesh.coordinates)
    if not clamped.any():
        raise InputError(f"case '{case.name}': key 'supports': no node of the mesh lies there")
    if not loadable.any():
        raise InputError(f"case '{case.name}': key 'load.region': no node of the mesh lies there")
    if (loadable & clamped).any():
        at = ",".join(f"{value:g}" for value in mesh.coordinates[loadable & clamped][0])
        raise InputError(
            f"case '{case.name}': key 'load.region' holds the clamped node at {at}, "
            "expected free nodes only"
        )
    nodes = LoadableNodes(np.flatnonzero(loadable), mesh.coordinates, mesh.cells, mesh.cell_type)
    try:
        case.load.check(nodes)
    except ValueError as error:
        raise InputError(f"case '{case.name}': load family: {error}") from None
    problem = EquilibriumProblem(mesh, case.material, clamped, case.solver)
    return Body(mesh, clamped, loadable, nodes, problem)
