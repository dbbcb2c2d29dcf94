"""Guard against inverted elements: the smallest J = det F over all Gauss points."""

from __future__ import annotations

from typing import Any

import basix
import numpy as np
import ufl
from mpi4py import MPI

from datagen.discretisation.element import ElementKind
from datagen.discretisation.element_loop import ElementLoop, Kernel
from datagen.discretisation.unknowns import Unknowns
from datagen.dolfinx_versions import COMPILER_OPTIONS, point_expression
from datagen.solver.forms.strain_energy import deformation_gradient


class MinimumJ:
    """Smallest J = det(I + ∇u) over the Gauss points of all cells.

    J is the ratio of deformed to undeformed volume. Where J ≤ 0 an element is inverted, and the
    strain energy, which holds ln J, is not defined.

    Parameters
    ----------
    unknowns : Unknowns
        Each rank evaluates the cells that it owns.
    kind : ElementKind
    """

    def __init__(self, unknowns: Unknowns, kind: ElementKind) -> None:
        state = unknowns.state
        domain = state.function_space.mesh
        cell = getattr(basix.CellType, domain.topology.cell_type.name)
        points, _ = basix.make_quadrature(cell, kind.quadrature_degree)
        u = ufl.split(state)[0] if kind.has_pressure else state
        self._comm = domain.comm
        self._expression: Any = point_expression(
            ufl.det(deformation_gradient(u)), points, COMPILER_OPTIONS
        )
        kernel = Kernel(self._expression.ufcx_expression.tabulate_tensor_float64, np.empty(0))
        count = len(unknowns.cell_dofs)
        places = np.arange(count * len(points), dtype=np.int32).reshape(count, -1)
        self._loop = ElementLoop(kernel, state, unknowns.cell_dofs, places, places.size)

    def value(self) -> float:
        """Smallest J at the current displacement, the same on every rank (collective)."""
        here = float(self._loop.run().min(initial=np.inf))
        return here if self._comm.size == 1 else float(self._comm.allreduce(here, op=MPI.MIN))
