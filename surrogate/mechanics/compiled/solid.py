"""A solid on the CPU, state by state, in compiled loops: any material and element.

The equations are those of `surrogate.mechanics.solids.solid`, which is for PyTorch's devices and
gradients.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from surrogate.mechanics.compiled import loops
from surrogate.mechanics.compiled.cells import Cells
from surrogate.mechanics.compiled.tapes import Tapes

if TYPE_CHECKING:
    from surrogate.mechanics.solids.solid import Solid

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Deformed:
    """A state at the quadrature points, in rows (`surrogate.mechanics.compiled.loops`).

    Attributes
    ----------
    f : array, (n_rows, d, d, n)
    j : array, (n_rows, n)
    dilation : array, (n_rows, n)
        θ, or J.
    inside : bool
        Whether J and θ are positive and finite everywhere.
    """

    f: Array
    j: Array
    dilation: Array
    inside: bool


class CompiledSolid:
    """Forces, stresses and tangents of a solid.

    Parameters
    ----------
    solid : Solid
        In double precision on the CPU.

    Attributes
    ----------
    cells : Cells
    """

    def __init__(self, solid: Solid) -> None:
        self._solid, numbers = solid, solid.material_of_cells().numpy()
        gradients = solid.gradients.numpy().swapaxes(1, 2)
        volumes = solid.volumes.numpy()
        self.cells = Cells.of(solid.cells.numpy(), gradients, volumes, 1.0, numbers)
        self._stress = Tapes.of([law.stress for law in solid.laws])
        fibres = np.zeros((len(volumes), 0, gradients.shape[3]))
        if solid.fibres is not None:
            fibres = solid.fibres[..., 0, 0].permute(2, 0, 1).numpy()
        self._fibres = self.cells.of_cells(fibres)
        self._none = np.empty((0, self.cells.volumes.shape[1]))
        self._functions: loops.Functions | None = None
        if solid.projects:
            shapes = solid.shapes.numpy()
            values = np.broadcast_to(shapes, (len(volumes), *shapes.shape))
            self._functions = loops.Functions(solid.corners.numpy(), self.cells.of_points(values))

    @cached_property
    def _energy(self) -> Tapes:
        return Tapes.of([law.energy for law in self._solid.laws])

    def slopes(self, u: Array) -> Array:
        """∇u: (n_points, d) in m → rows."""
        out = np.empty((len(self.cells.volumes), *self._tensor))
        loops.slopes_at(self.cells, u, out)
        return out

    def deformed(self, u: Array) -> Deformed:
        """A state, whatever it is: (n_points, d) in m."""
        f = np.empty((len(self.cells.volumes), *self._tensor))
        j = np.empty(self.cells.volumes.shape)
        inside = loops.deform(self.cells, np.ascontiguousarray(u), f, j)
        if self._functions is None:
            return Deformed(f, j, j, inside)
        dilation, positive = self._projected(j)
        return Deformed(f, j, dilation, inside and positive)

    def first_piola(self, state: Deformed) -> Array:
        """P in Pa, no meaning if a cell is inverted: rows."""
        found, pressure = self._stressed(state)
        if len(pressure):
            loops.add_pressures(state.f, pressure, found)
        return found

    def _stressed(self, state: Deformed) -> tuple[Array, Array]:
        """P without p, and p if there is θ: rows in Pa."""
        found, slope = np.empty_like(state.f), np.empty_like(state.dilation)
        if self._functions is None:
            slope = self._none
        of = state.f, state.j, state.dilation
        loops.stresses(self.cells, self._fibres, self._stress, *of, found, slope)
        return found, slope if self._functions is None else self._projected(slope)[0]

    def forces(self, stress: Array) -> Array:
        """Σ_q w_q P_q ∇N_a in N: rows in Pa → (n_points, d)."""
        out = np.zeros((self._solid.nodes, stress.shape[1]))
        loops.add_forces_of(self.cells, stress, out)
        return out

    def internal_forces(self, u: Array) -> Array:
        """f_int in N, no meaning if a cell is inverted: (N, n_points, d) in m → same."""
        found = np.zeros(u.shape)
        for row, each in enumerate(u):
            found[row] = self.forces(self.first_piola(self.deformed(each)))
        return found

    def inverted(self, u: Array) -> NDArray[np.int64]:
        """Number of inverted cells, as `Solid.inverted`: (N, n_points, d) in m → (N,)."""
        found = np.zeros(len(u), np.int64)
        for row, each in enumerate(u):
            state = self.deformed(each)
            if not state.inside:
                good = np.minimum(state.j, state.dilation) > 0
                good &= np.maximum(state.j, state.dilation) < np.inf
                numbers = self.cells.numbers
                bad = (~good).reshape(len(numbers), -1, self.cells.row).any(1)
                found[row] = len(np.unique(numbers[bad & (numbers >= 0)]))
        return found

    def cell_tangents(self, u: Array, relaxed: bool = False) -> Tensor:
        """K of every cell in N/m, as of `Solid.cell_tangents`: (N, n_points, d) in m."""
        return torch.cat([self._tangents(each, relaxed) for each in u])

    def _tangents(self, u: Array, relaxed: bool) -> Tensor:
        state, solid = self.deformed(u), self._solid
        count, _, corners, d = solid.gradients.shape
        tangent = np.zeros((count, corners * d, corners * d))
        of = self.cells, self._fibres, self._energy, state.f, state.j, state.dilation
        if self._functions is None:
            none = np.empty((0, *self._tensor))
            loops.tangents(*of, self._none, none, self._none, tangent)
            return torch.from_numpy(tangent[None])
        pressure = np.zeros_like(state.j) if relaxed else self._stressed(state)[1]
        mixed, curvature = np.empty_like(state.f), np.empty_like(state.j)
        loops.tangents(*of, pressure, mixed, curvature, tangent)
        each = self._functions.numbers.shape[1]
        by_dilation, by_pressure = np.zeros((2, count, corners * d, each))
        square, cof = np.zeros((count, each, each)), np.zeros_like(state.f)
        loops.add_pressures(state.f, np.ones_like(state.j), cof)
        loops.add_works(self.cells, self._functions, mixed, by_dilation)
        loops.add_works(self.cells, self._functions, cof, by_pressure)
        loops.add_squares(self.cells, self._functions, curvature, square)
        parts = tangent, by_dilation, by_pressure, square
        return solid.composed(*(torch.from_numpy(part[None]) for part in parts))

    @property
    def _tensor(self) -> tuple[int, int, int]:
        d, width = self.cells.gradients.shape[3:]
        return d, d, width

    def _projected(self, values: Array) -> tuple[Array, bool]:
        """Π of values, and whether it is positive and finite everywhere: rows → same."""
        functions = self._functions
        assert functions is not None
        total = np.zeros(int(functions.numbers.max()) + 1)
        loops.sums(self.cells, functions, values, total)
        found = np.empty_like(values)
        return found, loops.spread(self.cells, functions, self._solid.solved_mass(total), found)
