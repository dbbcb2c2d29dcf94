"""Guard against inverted elements: the smallest J = det F over all Gauss points."""

from __future__ import annotations

from typing import Any

import basix
import numpy as np
import ufl
from mpi4py import MPI

from datagen.dolfinx_versions import COMPILER_OPTIONS, evaluate, point_expression
from datagen.solver.element_loop import ElementLoop
from datagen.solver.material import deformation_gradient
from datagen.solver.weak_form import QUADRATURE_DEGREE


class MinimumJ:
    """Smallest J = det(I + ∇u) over the Gauss points of all cells.

    J is the ratio of deformed to undeformed volume. Where J ≤ 0 an element is inverted, and the
    strain energy, which holds ln J, is not defined.

    Parameters
    ----------
    u : dolfinx.fem.Function
        Displacement in m, P1 or Q1 vectors. Each rank evaluates the cells that it owns.
    """

    def __init__(self, u: Any) -> None:
        domain = u.function_space.mesh
        cell = getattr(basix.CellType, domain.topology.cell_type.name)
        points, _ = basix.make_quadrature(cell, QUADRATURE_DEGREE)
        j = ufl.det(deformation_gradient(u))
        self._domain = domain
        self._expression = point_expression(j, points, COMPILER_OPTIONS)
        count = domain.topology.index_map(domain.topology.dim).size_local
        self._cells = np.arange(count, dtype=np.int32)
        self._loop: ElementLoop | None = None
        if domain.comm.size == 1:
            kernel = self._expression.ufcx_expression.tabulate_tensor_float64
            places = np.arange(count * len(points), dtype=np.int32).reshape(count, -1)
            self._loop = ElementLoop(kernel, np.empty(0), u, places, places.size)

    def value(self) -> float:
        """Smallest J at the current displacement, the same on every rank (collective)."""
        if self._loop is not None:
            return float(self._loop.run().min())
        local = np.inf
        if self._cells.size:
            local = float(evaluate(self._expression, self._domain, self._cells).min())
        return float(self._domain.comm.allreduce(local, op=MPI.MIN))
