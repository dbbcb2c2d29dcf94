"""Node numbering of a distributed mesh against the coordinates of its degrees of freedom."""

from __future__ import annotations

import numpy as np
import pytest
from mpi4py import MPI

from datagen.dolfinx_versions import cell_blocks, functionspace
from datagen.mesh.distributed_mesh import make_mesh, node_numbering
from datagen.mesh.geometries import Box


@pytest.mark.parametrize(
    ("elements", "upper"), [((4, 3), (2.0, 1.0)), ((3, 2, 2), (2.0, 1.0, 1.0))]
)
def test_numbering_maps_degrees_of_freedom_to_nodes(
    elements: tuple[int, ...], upper: tuple[float, ...]
) -> None:
    mesh = make_mesh(Box(lower=(0.0,) * len(upper), upper=upper, elements=elements), MPI.COMM_SELF)
    space = functionspace(mesh.domain, ("Lagrange", 1, (mesh.coordinates.shape[1],)))
    numbering = node_numbering(mesh, cell_blocks(space), space.dofmap.index_map.size_local)
    at = space.tabulate_dof_coordinates()[:, : len(upper)]
    assert at == pytest.approx(mesh.coordinates[numbering.node_of_block])
    nodes = np.array([5, 0, 7])
    positions, blocks = numbering.owned_blocks(nodes)
    assert np.array_equal(numbering.node_of_block[blocks], nodes[positions])
