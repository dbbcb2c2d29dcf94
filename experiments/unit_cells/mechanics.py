r"""A unit cell whose material is known: series in the stretch, least energy, Newton's method.

On the path :math:`u(t) = t h + w(t)` of growing stretch, with w = 0 on the outer edge,

.. math::
    w = t w_1 + t^2 w_2 + t^3 w_3 + O(t^4), \qquad K w_1 = -K h, \qquad u_1 = h + w_1, \\
    K w_2 = -\tfrac{1}{2} f''[u_1, u_1], \qquad
    K w_3 = -f''[u_1, w_2] - \tfrac{1}{6} f'''[u_1, u_1, u_1]

with the derivatives K, f'' and f''' of the internal forces at rest (as
`surrogate.mechanics.series.body_series` has them under nodal forces). Of all :math:`h + \sum_k c_k
w_k` at t = 1 the state is that of the least strain energy; steps of Newton's method correct it.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
import torch
from numpy.typing import NDArray

from experiments.unit_cells.unit_cell import Prediction, UnitCell
from shared_schema import Grid, NeoHookean
from shared_schema.materials import ARRAYS, Invariants
from surrogate.learning.data import Geometry
from surrogate.mechanics import Equilibrium

Array = NDArray[np.float64]
SMALL_SLOPE = 1e-3  # largest gradient of the displacements whose differences are taken
ITERATIONS, HALVINGS, SETTLED = 20, 20, 1e-9


class SolidCell:
    """Mechanics of a unit cell.

    Parameters
    ----------
    cell : UnitCell
    material : NeoHookean
    """

    def __init__(self, cell: UnitCell, material: NeoHookean) -> None:
        self.cell, self.material = cell, material
        nodes, outer = len(cell.coordinates), cell.is_outer
        grid = Grid.in_a_row(nodes, 2)
        body = cell.coordinates, cell.triangles, "triangle", outer, ~outer, grid
        self.equilibrium = Equilibrium(Geometry(*body), material)

    def prediction(self, u: Array) -> Prediction:
        """Fields and energy of a displacement, (n_nodes, 2)."""
        solid = self.equilibrium.solid
        displacement = torch.from_numpy(u[None])
        f = solid.deformation_gradient(displacement)[:, :, :, 0, 0].numpy()
        p = solid.first_piola(displacement)[:, :, :, 0, 0].numpy()
        j = f[0, 0] * f[1, 1] - f[0, 1] * f[1, 0]
        trace = np.square(f).sum((0, 1))  # of C in the plane
        psi = self.material.energy(Invariants(trace + 1, trace + j**2, j), ARRAYS)
        values = self.cell.at_nodes(np.stack([*p[0], p[1, 1], p[1, 0], psi], axis=1))
        energy = float(self.cell.areas @ psi / self.cell.sides.prod())
        return Prediction(np.column_stack([u, values]), energy)

    def gradient(self, u: Array) -> Array:
        """∇u of the triangles: (n_nodes, 2) → (n_triangles, 4)."""
        solid = self.equilibrium.solid
        f = solid.deformation_gradient(torch.from_numpy(u[None]))[:, :, :, 0, 0].numpy()
        return np.asarray((f - np.eye(2)[:, :, None]).reshape(4, -1).T)

    def is_inverted(self, u: Array) -> bool:
        """True if a displacement, (n_nodes, 2), turns a triangle over."""
        return bool(self.equilibrium.inverted(u[None])[0])

    @cached_property
    def terms(self) -> tuple[Array, Array, Array]:
        """w₁, w₂ and w₃, (n_nodes, 2) each."""
        body = self.equilibrium
        h = self.cell.homogeneous[None]
        tangents = self._tangents(np.zeros_like(h))
        first = -body.linear_response(self._product(tangents, h) * body.free)
        u1 = h + first
        slope = np.abs(self.gradient(u1[0])).max()
        step = SMALL_SLOPE / slope if slope > 0 else 1.0

        def forces(u: Array) -> Array:
            return body.out_of_balance(u, np.zeros_like(u))

        even = (forces(step * u1) + forces(-step * u1)) / (2 * step**2)
        second = -body.linear_response(even)
        bent = step**2 * second
        odd = (forces(step * u1 + bent) - forces(-step * u1 + bent)) / (2 * step**3)
        third = -body.linear_response(odd)
        return first[0], second[0], third[0]

    def series(self) -> Array:
        """State of least energy of the series, (n_nodes, 2)."""
        body, h, modes = self.equilibrium, self.cell.homogeneous, np.stack(self.terms)
        nothing = np.zeros_like(h[None])

        def at(c: Array) -> Array:
            return h[None] + np.tensordot(c, modes, 1)[None]

        starts = (np.full(3, t) ** np.arange(3.0) for t in (1.0, 0.5, 0.25, 0.0))
        c: Array = next(start for start in starts if not body.inverted(at(start))[0])
        for _ in range(ITERATIONS):
            u = at(c)
            slope = np.tensordot(modes, body.out_of_balance(u, nothing)[0], 2)
            bent = [self._product(self._tangents(u), mode[None])[0] for mode in modes]
            curvature = np.tensordot(modes, np.stack(bent), ((1, 2), (1, 2)))
            step = -np.linalg.solve(curvature, slope)
            energy = body.potential(u, nothing)[0]
            parts = (0.5**k * step for k in range(HALVINGS))
            lower = (s for s in parts if body.potential(at(c + s), nothing)[0] <= energy)
            taken = next(lower, None)
            if taken is None:
                break
            c = c + taken
            if np.abs(taken).max() < SETTLED:
                break
        return np.asarray(at(c)[0])

    def corrected(self, u: Array) -> Array:
        """State after one step of Newton's method, halved until the energy falls."""
        body, state = self.equilibrium, u[None]
        nothing = np.zeros_like(state)
        step, _ = body.newton_step(state, body.out_of_balance(state, nothing))
        energy = body.potential(state, nothing)[0]
        trials = (state + 0.5**k * step for k in range(HALVINGS))
        lower = (trial for trial in trials if body.potential(trial, nothing)[0] <= energy)
        return np.asarray(next(lower, state)[0])

    def _tangents(self, u: Array) -> Array:
        """K of every triangle, (n_triangles, 6, 6)."""
        return np.asarray(self.equilibrium.solid.cell_tangents(torch.from_numpy(u))[0].numpy())

    def _product(self, tangents: Array, u: Array) -> Array:
        """K u, (1, n_nodes, 2)."""
        triangles = self.cell.triangles
        local = u[0, triangles].reshape(len(triangles), -1)
        forces = np.zeros_like(u)
        of_corners = np.einsum("cij,cj->ci", tangents, local).reshape(*triangles.shape, 2)
        np.add.at(forces[0], triangles, of_corners)
        return forces
