"""Assemble the stiffness of the undeformed body, the tangent of linear elasticity."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from mpi4py import MPI
from numpy.typing import NDArray
from scipy.sparse import coo_array

from datagen.discretisation.element import Element
from datagen.mesh.distributed_mesh import distributed
from datagen.solver.equilibrium import EquilibriumProblem
from datagen.solver.settings import SolverSettings
from shared_schema.common.bodies.groups import RawMesh
from shared_schema.materials import Material
from shared_schema.stiffness import Stiffness


def stiffness_of(
    mesh: RawMesh,
    material: Material | Sequence[Material],
    element: Element = "linear",
    parts: NDArray[np.int64] | None = None,
    fibres: NDArray[np.float64] | None = None,
) -> Stiffness:
    """Assemble ∂f_int/∂u at u = 0, in N/m, without supports, on this rank alone.

    The element must have no unknowns beside the displacements of the nodes of the mesh
    (`ElementKind.corners_only`): without those, the stiffness of the nodes is not sparse.
    """
    free = np.zeros(len(mesh.coordinates), dtype=bool)
    domain = distributed(mesh, MPI.COMM_SELF)
    settings = SolverSettings(tolerance=1.0, linear_solver="lu")  # nothing is solved
    problem = EquilibriumProblem(domain, material, free, settings, element, parts, fibres=fibres)
    d, nodes = problem.dimension, problem.numbering.node_of_block
    number = (nodes[:, None] * d + np.arange(d)).ravel()
    indptr, indices, data = problem.tangent().getValuesCSR()
    problem.close()
    row_of = np.repeat(number, np.diff(indptr))
    matrix = coo_array((data, (row_of, number[indices])), shape=(number.size,) * 2).tocsr()
    matrix.sort_indices()
    return Stiffness(matrix.data, matrix.indices.astype(np.int64), matrix.indptr.astype(np.int64))
