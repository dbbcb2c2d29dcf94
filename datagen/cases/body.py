"""The body of a case with its equilibrium problem."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from datagen.cases.case import Case
from datagen.cases.placed_body import PlacedBody, placed
from datagen.mesh.distributed_mesh import Mesh, distributed, make_mesh
from datagen.solver.equilibrium import EquilibriumProblem
from shared_schema.common.bodies.command_loads import CommandLoads
from shared_schema.common.errors import InputError

logger = logging.getLogger(__name__)
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

    def reshaped(self, values: NDArray[np.float64], driven: Driven | None = None) -> Body:
        """Build the body, with its problem, in the shape of some parameters, (n,) (collective)."""
        comm, shape = self.mesh.domain.comm, self.of_shape(values)
        made = _with_problem(shape, distributed(shape.mesh, comm), driven)
        made.problem.meanwhile = self.problem.meanwhile
        return made


def make_body(
    case: Case,
    comm: Any,
    driven: Driven | None = None,
    parameters: Mapping[str, float] = MappingProxyType({}),
) -> Body:
    """Mesh the case's geometry on the ranks of `comm` and build its problem (collective).

    Parameters
    ----------
    case : Case
    comm : mpi4py communicator
    driven : callable, optional
        From mesh and held components, (n_nodes, d), to the loads that the problem is built for; by
        default it is built for those of the load families.
    parameters : mapping of str to float
        Those of the shape, of a mesh with ranges of them; the others are in their middle.

    Raises
    ------
    InputError
        On every rank, if meshing or reading fails, a region holds no node, a loadable node is
        clamped, a load family does not fit the mesh, a cell has no material, a part of the mesh is
        not supported, or parameters are unknown or tangle the mesh.
    """
    try:
        mesh = make_mesh(case.mesh, comm)
    except InputError as error:
        raise InputError(f"case '{case.name}': {error}") from None
    body = placed(case, mesh)
    if parameters:
        body = body.of_shape(_values(mesh, parameters))
        mesh = distributed(body.mesh, comm)
    return _with_problem(body, mesh, driven)


def _values(mesh: Mesh, parameters: Mapping[str, float]) -> NDArray[np.float64]:
    """Parameters of a shape, (n,); warns if one is outside of its range."""
    if mesh.shapes is None:
        name = next(iter(parameters))
        raise InputError(f"parameter {name}: the case's mesh has no ranges of some", "parameter")
    values = mesh.shapes.checked(parameters, mesh.cells, mesh.cell_type)
    for outside in mesh.shapes.outside(values):
        logger.warning(outside)
    return values


def _with_problem(body: PlacedBody, mesh: Mesh, driven: Driven | None) -> Body:
    """Set up the equilibrium problem of a body on its distributed mesh (collective)."""
    case = body.case
    drive = body.loads if driven is None else driven(mesh, body.held)
    known = mesh, case.material, body.held, case.solver, case.element, body.parts
    following = (*drive.following, *body.loads.actuators.loads)
    try:
        problem = EquilibriumProblem(*known, drive.moved, following, body.fibres)
    except InputError as error:
        raise InputError(f"case '{case.name}': {error}") from None
    return Body(case, mesh, body.held, body.parts, body.fibres, body.loads, problem)
