r"""Stresses and reactions of the current state of a body on one rank.

Elements with a dilation θ (`datagen.discretisation.element`) have the stresses of
:math:`\bar F = (θ/J)^{1/d} F`, the deformation gradient that their energy is that of.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import basix
import dolfinx
import numpy as np
import ufl
from numpy.typing import NDArray

from datagen.discretisation.element_loop import ElementLoop
from datagen.dolfinx_versions import (
    COMPILER_OPTIONS,
    evaluate,
    form,
    functionspace,
    point_expression,
)
from datagen.solver.equilibrium import EquilibriumProblem
from datagen.solver.strain_energy import completed, deformation_gradient, energy_density
from datagen.solver.weak_form import cell_volumes, kernels_of
from shared_schema.common.bodies.equilibrium import mean_edge, stress_fields
from shared_schema.materials import Material

Array = NDArray[np.float64]


class CellStresses:
    """F, P = ∂W/∂F and W at the middle of every cell.

    Parameters
    ----------
    problem : EquilibriumProblem
        Its mesh lives on this rank alone.
    materials : sequence of Material
    parts : array of int, (n_cells,), or None
        Position of each cell's material; all cells are of the first by default.
    """

    def __init__(
        self,
        problem: EquilibriumProblem,
        materials: Sequence[Material],
        parts: NDArray[np.int64] | None,
    ) -> None:
        self._update_dilation: Callable[[], None]
        domain = problem.mesh.domain
        kind = getattr(basix.CellType, domain.topology.cell_type.name)
        middle = basix.geometry(kind).mean(axis=0)[None]
        f = ufl.variable(completed(self._gradient(problem)))
        self._mesh, self._pieces = problem.mesh, []
        count = len(problem.mesh.cells)
        of_cells = np.zeros(count, dtype=np.int64) if parts is None else parts
        local = problem.mesh.of_local_cells(of_cells)
        fibres = problem.forms.fibres
        function = None if fibres is None else fibres.function()
        for number, material in enumerate(materials):
            directions = [] if fibres is None else fibres.directions(function, number)
            w = energy_density(f, material, domain, directions=directions)
            p = ufl.diff(w, f)
            values = [tensor[i, j] for tensor in (f, p) for i in range(3) for j in range(3)]
            expression = point_expression(ufl.as_vector([*values, w]), middle, COMPILER_OPTIONS)
            self._pieces.append((expression, np.flatnonzero(local == number).astype(np.int32)))

    def _gradient(self, problem: EquilibriumProblem) -> Any:
        """F, or F̄ of elements with a dilation, as a UFL expression of the current state."""
        kind, mesh, state = problem.kind, problem.mesh, problem.u
        self._update_dilation = lambda: None
        if kind.dilation == "pointwise":
            return deformation_gradient(state)
        if kind.dilation == "continuous":
            u, t, _ = ufl.split(state)
            dilation = 1 + t / mean_edge(mesh.coordinates, mesh.cells)
        else:
            of_cells = dolfinx.fem.Function(functionspace(mesh.domain, ("DG", 0, (1,))))
            u, dilation = state, of_cells[0]
            degree = {"quadrature_degree": kind.quadrature_degree}
            dx = ufl.Measure("dx", mesh.domain, metadata=degree)
            deformed = form(ufl.det(deformation_gradient(u)) * dx, COMPILER_OPTIONS)
            (kernel,) = kernels_of(deformed).values()
            count, cell_dofs = len(problem.unknowns.cell_dofs), problem.unknowns.cell_dofs
            places = np.arange(count, dtype=np.int32)[:, None]
            loop = ElementLoop(kernel, state, cell_dofs, places, count)
            volumes = cell_volumes(problem.unknowns, dx)

            def update() -> None:
                of_cells.x.array[:count] = loop.run() / volumes

            self._update_dilation = update
        f = deformation_gradient(u)
        return (dilation / ufl.det(f)) ** (1 / problem.dimension) * f

    def fields(self) -> dict[str, Array]:
        """Fields of stress of the current state, (n_cells, …), in the order of the mesh's cells.

        They are gathered from the ranks that own the cells (collective).
        """
        self._update_dilation()
        topology = self._mesh.domain.topology
        numbers = np.asarray(topology.original_cell_index)  # of this rank's cells, owned ones first
        owned = topology.index_map(topology.dim).size_local
        found = np.zeros((len(numbers), 19))
        for expression, cells in self._pieces:
            if cells.size:
                found[cells] = evaluate(expression, self._mesh.domain, cells).reshape(-1, 19)
        here = np.zeros((len(self._mesh.cells), 19))
        here[numbers[:owned]] = found[:owned]
        values = np.empty_like(here)
        self._mesh.domain.comm.Allreduce(here, values)
        f, p = values[:, :9].reshape(-1, 3, 3), values[:, 9:18].reshape(-1, 3, 3)
        return stress_fields(f, p, values[:, 18])


def reactions_of_supports(problem: EquilibriumProblem, held: NDArray[np.bool_]) -> Array:
    """Forces of the supports on the body in the current state: (n_nodes, d) in N, else 0."""
    return np.where(held, problem.reactions(), 0.0)
