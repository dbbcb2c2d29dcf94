r"""Equilibrium of a body of quadratic elements, whose predictions are those of its nodes.

The *points* of the elements are the nodes of the mesh, that is the corners :math:`u_c` of the
cells, and the points between them, :math:`u_m`. Loads act at the nodes, so that in any state the
points between them are where the strain energy is least:

.. math:: u_m(u_c) = \arg\min_{u_m} E(u_c, u_m).

Newton's method with a line search finds them from their linear interpolation, in `incompressible`
triangles and tetrahedra after a step that makes the volumes right. So a displacement of
the nodes is one of all points, and the error of a prediction is not that of the interpolation: at
the nodes of an equilibrium, the points are those of the equilibrium itself.

As in `datagen.discretisation.unknowns`, a component is held between corners if it is at all of
them, a pressure acts on the facets that the corners span, and a force at a point counts as the
forces at the corners which do the same work.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from shared_schema.common.bodies.imperfection import imperfection
from shared_schema.common.bodies.quadratic.quadratic_cells import BETWEEN, NAMES
from shared_schema.material import Materials
from surrogate.data.geometry import Geometry
from surrogate.mechanics.follower_pressure import FollowerPressure
from surrogate.mechanics.newton_steps import norms
from surrogate.mechanics.out_of_balance import Equilibrium

Array = NDArray[np.float64]
ITERATIONS, HALVINGS = 20, 20  # of the points between the nodes
SMALL = 1e-9  # of the displacement: a step after which the next one is a rounding error


class QuadraticEquilibrium(Equilibrium):
    """Equilibria of one body of quadratic elements; displacements and forces are of its points.

    Parameters
    ----------
    geometry : Geometry
        Of the nodes.
    material : ShippedMaterial, or tuple of some

    Attributes
    ----------
    interpolation : sparse array, (n_points, n_nodes)
        Linear shape functions of the corners at the points, the nodes first.
    """

    def __init__(self, geometry: Geometry, material: Materials) -> None:
        points, self.interpolation = on_points(geometry)
        super().__init__(points, material)
        self._material, self.nodes = material, len(geometry.coordinates)

    def under(self, pressure: FollowerPressure) -> Equilibrium:
        """Return equilibria of the same body, under the pressures of one load case as well."""
        return super().under(replace(pressure, coordinates=self.geometry.coordinates))

    def at_points(self, u: Array) -> Array:
        """Displacements of all points by those of the nodes, in m.

        From (N, n_nodes, d) to (N, n_points, d). The points between are interpolated where cells
        are inverted.
        """
        found = np.stack([self.interpolation @ each for each in u])
        for row in np.flatnonzero(self.inverted(found) == 0):
            found[row] = self._least_energy(found[row : row + 1])[0]
        return found

    def forces_at_points(self, f: Array) -> Array:
        """Forces on all points by those on the nodes, in N: (N, n_nodes, d) → (N, n_points, d)."""
        return np.pad(f, ((0, 0), (0, len(self.free) - self.nodes), (0, 0)))

    def forces_at_nodes(self, f: Array) -> Array:
        """Forces on the nodes that do the work of those on all points: the inverse shapes."""
        return np.stack([self.interpolation.T @ each for each in f])

    def imperfection(self) -> Array:
        """Imperfection of the nodes, interpolated."""
        d = self.geometry.dimension
        return np.asarray(self.interpolation @ imperfection((self.nodes, d)))

    @cached_property
    def _between(self) -> Equilibrium:
        """The same body, whose nodes are held."""
        held = ~self.free
        held[: self.nodes] = True
        return Equilibrium(replace(self.geometry, single=held), self._material)

    def _least_energy(self, u: Array) -> Array:
        """Move the points between the nodes to where the energy is least, (1, n_points, d)."""
        body, nothing = self._between, np.zeros_like(u)
        u = body.relaxed(u, nothing)
        for _ in range(ITERATIONS):
            energy, r = body.potential(u, nothing), body.out_of_balance(u, nothing)
            step, _ = body.newton_step(u, r)
            for halving in range(HALVINGS):
                trial = u + 0.5**halving * step
                if body.potential(trial, nothing) <= energy + body.rounding:
                    break
            else:
                return u
            u = trial
            if norms(step) <= SMALL * norms(u):
                break
        return u


def on_points(geometry: Geometry) -> tuple[Geometry, csr_array]:
    """Geometry of the points of quadratic elements; their interpolation from the nodes.

    Grid and groups stay those of the nodes.
    """
    cells, count = geometry.cells, len(geometry.coordinates)
    between = BETWEEN[geometry.cell_type]
    corners = np.full((len(cells), len(between), max(map(len, between))), -1)
    for number, some in enumerate(between):
        corners[:, number, : len(some)] = np.sort(cells[:, some], axis=1)
    of_points, numbers = np.unique(
        corners.reshape(-1, corners.shape[2]), axis=0, return_inverse=True
    )
    sizes = (of_points >= 0).sum(axis=1)
    starts = np.concatenate([np.arange(count), count + np.cumsum([0, *sizes])])
    columns = np.concatenate([np.arange(count), of_points[of_points >= 0]])
    weights = np.concatenate([np.ones(count), np.repeat(1 / sizes, sizes)])
    interpolation = csr_array((weights, columns, starts), shape=(len(starts) - 1, count))
    held = np.asarray(interpolation @ geometry.free.astype(np.float64)) == 0.0
    points = replace(
        geometry,
        coordinates=np.asarray(interpolation @ geometry.coordinates),
        cells=np.concatenate([cells, count + numbers.reshape(len(cells), -1)], axis=1),
        cell_type=NAMES[geometry.cell_type],
        clamped=held.all(axis=1),
        single=held,
    )
    return points, interpolation
