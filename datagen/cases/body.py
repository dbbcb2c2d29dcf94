"""The body of a case with its equilibrium problem."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from datagen.cases.case import Case
from datagen.cases.placed_body import PlacedBody, placed
from datagen.mesh.distributed_mesh import Mesh, make_mesh
from datagen.solver.equilibrium import EquilibriumProblem
from shared_schema.common.bodies.command_loads import CommandLoads
from shared_schema.common.errors import InputError

Driven = Callable[[Mesh, NDArray[np.bool_]], CommandLoads]


@dataclass(frozen=True)
class Body(PlacedBody):
    """A body with its equilibrium problem.

    Attributes
    ----------
    mesh : Mesh
    problem : EquilibriumProblem
        Built once; distributed over the ranks of the communicator that the body was made with.
    """

    mesh: Mesh
    problem: EquilibriumProblem


def make_body(case: Case, comm: Any, driven: Driven | None = None) -> Body:
    """Mesh the case's geometry on the ranks of `comm` and build its problem (collective).

    Parameters
    ----------
    case : Case
    comm : mpi4py communicator
    driven : callable, optional
        From mesh and held components, (n_nodes, d), to the loads that the problem is built for; by
        default it is built for those of the load families.

    Raises
    ------
    InputError
        On every rank, if meshing or reading fails, a region holds no node, a loadable node is
        clamped, a load family does not fit the mesh, a cell has no material, or a part of the mesh
        is not supported.
    """
    try:
        mesh = make_mesh(case.mesh, comm)
    except InputError as error:
        raise InputError(f"case '{case.name}': {error}") from None
    body = placed(case, mesh)
    drive = body.loads if driven is None else driven(mesh, body.held)
    known = mesh, case.material, body.held, case.solver, case.element, body.parts
    try:
        problem = EquilibriumProblem(*known, drive.moved, drive.surfaces, body.fibres)
    except InputError as error:
        raise InputError(f"case '{case.name}': {error}") from None
    return Body(case, mesh, body.held, body.parts, body.fibres, body.loads, problem)
