r"""Multigrid of the undeformed body that turns with the body, as a preconditioner.

Under large deformations parts of a body turn by large angles, while their strains stay moderate.
The tangent is then nearly that of the undeformed body, turned at every point b by the rotation
there:

.. math::
    K(u) ≈ \mathcal R K_0 \mathcal R^T, \qquad \mathcal R = \operatorname{diag}(R_b), \qquad
    P = \mathcal R \, M_0 \, \mathcal R^T ≈ K(u)^{-1},

with one multigrid cycle :math:`M_0 ≈ K_0^{-1}`, whose hierarchy is built once. :math:`R_b` is the
rotation in the polar decomposition of the mean of the deformation gradients :math:`F` at the
centres of the cells around the point, by Newton's iteration :math:`R ← (R + R^{-T}) / 2` (Higham
1986).
"""

from __future__ import annotations

import basix
import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc
from scipy.sparse import coo_array, csr_array

from datagen.discretisation.unknowns import Unknowns
from datagen.dolfinx_versions import geometry_nodes
from datagen.solver.linear_solver import multigrid

POLAR_STEPS = 3  # of Newton's iteration; strains of 30 % are then removed to 1e-7
SMALLEST = 1e-3  # determinant of a mean F, below which a point is not turned

Array = NDArray[np.float64]


class CorotatedMultigrid:
    """Preconditioner P of a body's tangent, a context of PETSc's type ``python``.

    Parameters
    ----------
    undeformed : PETSc.Mat
        K₀ in N/m, with the identity in held rows, which this object keeps.
    points : array, (n_owned_points, d)
        Positions in m of the points that this rank owns.
    unknowns : Unknowns
    """

    def __init__(self, undeformed: PETSc.Mat, points: Array, unknowns: Unknowns) -> None:
        self.undeformed = undeformed
        self._cycle = multigrid(undeformed, points)
        self._turned = undeformed.createVecRight()
        self._state = unknowns.state.x.array
        self._cells = unknowns.cell_dofs
        d = points.shape[1]
        self._corners, self._gradients = _centre_gradients(unknowns)
        self._mean = _mean_around(self._cells[:, ::d] // d, len(points))
        self._rotations = np.broadcast_to(np.eye(d), (len(points), d, d))

    def turn(self) -> None:
        """Follow the body to its present state."""
        d = self._rotations.shape[1]
        u = self._state[self._cells[:, : self._corners * d]].reshape(-1, self._corners, d)
        f = np.einsum("cai,caj->cij", u, self._gradients) + np.eye(d)
        self._rotations = rotations((self._mean @ f.reshape(-1, d * d)).reshape(-1, d, d))

    def apply(self, pc: PETSc.PC, x: PETSc.Vec, y: PETSc.Vec) -> None:
        """y = P x, called by PETSc."""
        shape = self._rotations.shape[:2]
        turned = np.einsum("nji,nj->ni", self._rotations, x.array_r.reshape(shape))
        self._turned.array_w[:] = turned.ravel()
        self._cycle.apply(self._turned, y)
        back = np.einsum("nij,nj->ni", self._rotations, y.array_r.reshape(shape))
        y.array_w[:] = back.ravel()

    def destroy(self, pc: PETSc.PC) -> None:
        """Release PETSc's memory, called by PETSc as it releases the solver."""
        for thing in (self._cycle, self._turned, self.undeformed):
            thing.destroy()


def rotations(f: Array) -> Array:
    """Rotations R of the polar decompositions F = R U: (n, d, d) → (n, d, d).

    They are the identity where det F is not safely positive.
    """
    r = np.where((np.linalg.det(f) > SMALLEST)[:, None, None], f, np.eye(f.shape[1]))
    for _ in range(POLAR_STEPS):
        r = 0.5 * (r + np.linalg.inv(r).transpose(0, 2, 1))
    return r


def _mean_around(points: NDArray[np.int32], owned: int) -> csr_array:
    """Operator from values of the cells to their means around each owned point.

    Parameters
    ----------
    points : array of int, (n_cells, n_points)
        Points of this rank's cells, owned ones first.
    owned : int
        Number of points that this rank owns.
    """
    cells = np.repeat(np.arange(len(points)), points.shape[1])
    ones = np.ones(points.size)
    total = coo_array((ones, (points.ravel(), cells)), shape=(points.max() + 1, len(points)))
    total = total.tocsr()[:owned]
    total.data /= np.repeat(np.diff(total.indptr), np.diff(total.indptr))
    return total


def _centre_gradients(unknowns: Unknowns) -> tuple[int, Array]:
    """Number of corners, and ∇N_a at the centres of the cells: (n_cells, n_corners, d) in 1/m."""
    domain = unknowns.state.function_space.mesh
    cell = getattr(basix.CellType, domain.topology.cell_type.name)
    element = basix.create_element(
        basix.ElementFamily.P, cell, 1, basix.LagrangeVariant.gll_warped
    )
    d = domain.geometry.dim
    centre = basix.geometry(cell).mean(axis=0)[None, :]
    slopes = element.tabulate(1, centre)[1:].reshape(d, -1).T  # (n_corners, d)
    nodes = geometry_nodes(domain)[: len(unknowns.cell_dofs)]
    x = domain.geometry.x[nodes][:, :, :d]
    jacobians = np.einsum("cai,aj->cij", x, slopes)
    return len(slopes), np.einsum("aj,cji->cai", slopes, np.linalg.inv(jacobians))
