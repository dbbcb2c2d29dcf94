"""A solid on the CPU, state by state, in compiled loops: any material and element.

The equations are those of `surrogate.mechanics.solids.solid`, which is for PyTorch's devices and
gradients.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from surrogate.mechanics.compiled import loops
from surrogate.mechanics.compiled.cells import Cells
from surrogate.mechanics.compiled.program import Programs

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
        self._fibres = self.cells.of_cells(fibre_components(solid))
        laws = solid.recorded_laws
        self._programs = {
            name: Programs.of(laws, 2 * solid.projects, [name])
            for name in ("volume", "slope", "stress", "derivatives")
            if solid.projects or name != "slope"
        }
        self._functions: loops.Functions | None = None
        self._at_once: Programs | None = None
        if not solid.projects:
            self._at_once = Programs.of(laws, 0, ["volume", "stress"])
        else:
            shapes = solid.shapes.numpy()
            values = np.broadcast_to(shapes, (len(volumes), *shapes.shape))
            self._functions = loops.Functions(solid.corners.numpy(), self.cells.of_points(values))

    def slopes(self, u: Array) -> Array:
        """∇u: (n_points, d) in m → rows."""
        out = np.empty((len(self.cells.volumes), *self._tensor))
        loops.slopes_at(self.cells, u, out)
        return out

    def deformed(self, u: Array) -> Deformed:
        """A state, whatever it is: (n_points, d) in m."""
        f = np.empty((len(self.cells.volumes), *self._tensor))
        loops.deform(self.cells, np.ascontiguousarray(u), f)
        dilation = j = self._outputs("volume", f, [])[:, 0]
        inside = bool(j.min() > 0 and j.max() < np.inf)
        if self._functions is not None:
            dilation, positive = self._projected(j)
            inside &= positive
        return Deformed(f, j, dilation, inside)

    def first_piola(self, state: Deformed) -> Array:
        """P in Pa, no meaning if a cell is inverted: rows."""
        beside = self._beside(state)
        return self._outputs("stress", state.f, beside).reshape(state.f.shape)

    def stressed(self, u: Array) -> tuple[Array, Array, Array, bool]:
        """F and P in rows, forces in N, and whether no cell is inverted: (n_points, d) in m.

        P and forces have no meaning if one is.
        """
        if self._at_once is None:
            state = self.deformed(u)
            piola = self.first_piola(state)
            return state.f, piola, self.forces(piola), state.inside
        f, piola = np.empty((2, len(self.cells.volumes), *self._tensor))
        out = np.zeros(u.shape)
        of = self.cells, self._at_once, self._fibres, np.ascontiguousarray(u)
        return f, piola, out, loops.stress_and_forces(*of, f, piola, out)

    def _beside(self, state: Deformed, relaxed: bool = False) -> list[Array]:
        """θ and p, if there are some; p of a relaxed tangent is zero."""
        if self._functions is None:
            return []
        if relaxed:
            return [state.dilation, np.zeros_like(state.dilation)]
        slope = self._outputs("slope", state.f, [state.dilation])[:, 0]
        return [state.dilation, self._projected(slope)[0]]

    def _outputs(self, name: str, f: Array, beside: Sequence[Array]) -> Array:
        """Outputs of a program at the points: rows → (n_rows, n_outputs, n)."""
        programs = self._programs[name]
        found = np.empty((len(f), programs.outputs.shape[1], f.shape[3]))
        rows = stacked(beside, self.cells.volumes)
        loops.outputs_of(self.cells, programs, self._fibres, f, rows, found)
        return found

    def forces(self, stress: Array) -> Array:
        """Σ_q w_q P_q ∇N_a in N: rows in Pa → (n_points, d)."""
        out = np.zeros((self._solid.nodes, stress.shape[1]))
        loops.add_forces_of(self.cells, stress, out)
        return out

    def internal_forces(self, u: Array) -> Array:
        """f_int in N, no meaning if a cell is inverted: (N, n_points, d) in m → same."""
        found = np.zeros(u.shape)
        for row, each in enumerate(u):
            found[row] = self.stressed(each)[2]
        return found

    def viscous_forces(self, viscosity: Array, u: Array, v: Array) -> Array:
        """Forces in N of stresses η sym(Fᵀ ∇v), with η of every cell in Pa s, (n_cells,).

        Displacements are in m, velocities in m/s, (n_points, d) each.
        """
        found, eta = np.zeros(u.shape), self.cells.of_cells(viscosity)
        both = np.ascontiguousarray(u), np.ascontiguousarray(v)
        loops.add_viscous_forces(self.cells, eta, both[0], both[1], found)
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
        beside, functions = (
            stacked(self._beside(state, relaxed), self.cells.volumes),
            self._functions,
        )
        rows = 0 if functions is None else len(state.f)
        parts = np.empty((rows, 2 * d * d + 1, state.f.shape[3]))
        of = self.cells, self._programs["derivatives"], self._fibres, state.f, beside
        loops.tangents(*of, tangent, parts)
        if functions is None:
            return torch.from_numpy(tangent[None])
        each = functions.numbers.shape[1]
        by_dilation, by_pressure = np.zeros((2, count, corners * d, each))
        square = np.zeros((count, each, each))
        loops.add_works(self.cells, functions, parts[:, : d * d], by_dilation)
        loops.add_works(self.cells, functions, parts[:, d * d : -1], by_pressure)
        loops.add_squares(self.cells, functions, parts[:, -1], square)
        found = tangent, by_dilation, by_pressure, square
        return solid.composed(*(torch.from_numpy(part[None]) for part in found))

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


def fibre_components(solid: Solid) -> Array:
    """Directions of the families in all cells, if there are some: (n_cells, families · d)."""
    if solid.fibres is None:
        return np.zeros((len(solid.cells), 0))
    found: Array = solid.fibres[..., 0, 0].permute(2, 0, 1).flatten(1).numpy()
    return found


def stacked(fields: Sequence[Array], like: Array) -> Array:
    """Scalars at the points, (n_rows, n) each, as (n_rows, n_fields, n)."""
    return np.stack(fields, 1) if fields else np.empty((len(like), 0, like.shape[1]))
