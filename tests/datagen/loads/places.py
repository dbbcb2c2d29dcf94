"""Loadable nodes of boxes, and load families by their names."""

from __future__ import annotations

from typing import Any

import numpy as np
from mpi4py import MPI

from datagen.mesh.box import Box
from datagen.mesh.distributed_mesh import make_mesh
from shared_schema.loads import LoadableNodes, LoadFamily, load_family
from shared_schema.loads.regions import Region


def place(region: dict[str, Any], elements: tuple[int, ...] = (4, 2)) -> LoadableNodes:
    """Loadable nodes of a 4 x 1 (x 1) box in a region."""
    upper = (4.0, 1.0, 1.0)[: len(elements)]
    lower = (0.0,) * len(elements)
    mesh = make_mesh(Box(lower=lower, upper=upper, elements=elements), MPI.COMM_SELF)
    nodes = np.flatnonzero(Region(**region).select(mesh.coordinates))
    return LoadableNodes(nodes, mesh.coordinates, mesh.cells, mesh.cell_type)


def family(name: str, **keys: Any) -> LoadFamily:
    return load_family({"family": name, "region": {}, **keys})
