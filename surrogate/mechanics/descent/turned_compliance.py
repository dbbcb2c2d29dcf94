r"""The compliance of a body in a time step, turned with its points.

.. math:: P = R \, (K(0) + A)^{-1} R^T \approx (K(u) + A)^{-1}

with the rotation R of every point, that of the mean deformation gradient of the cells around it.
The inertia A (`surrogate.mechanics.equilibrium.inertia`) is the same whichever way a point is
turned, and stiff along the modes that are soft at rest. So turning displacements is enough here,
unlike at rest (`surrogate.mechanics.descent.carried_compliance`), and takes half of the time: one
solve. Where waves cross the body many times in a step, it is worse.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from surrogate.mechanics.compiled.fields import compiled
from surrogate.mechanics.equilibrium.out_of_balance import Equilibrium
from surrogate.mechanics.matrices.factors import sum_of_cells

Array = NDArray[np.float64]
POLAR = 4  # iterations for a rotation


class TurnedCompliance:
    """P of one body in steps of one length, for any state.

    Parameters
    ----------
    equilibrium : Equilibrium
        In a step. Its factor of K(0) + A is used.
    """

    def __init__(self, equilibrium: Equilibrium) -> None:
        self._equilibrium, solid = equilibrium, equilibrium.solid
        gradients, volumes = solid.gradients.numpy(), solid.volumes.numpy()
        cells, points = solid.cells.numpy(), len(equilibrium.free)
        of_cells = np.einsum("cq,cqbj->jcb", volumes, gradients)  # means times volumes
        rows = np.broadcast_to(of_cells[:, :, None], (*of_cells.shape, cells.shape[1]))
        around = np.bincount(cells.ravel(), volumes.sum(axis=1).repeat(cells.shape[1]), points)
        sums = (sum_of_cells(each, cells, points) for each in rows)
        self._slopes = [csr_array(each / around[:, None]) for each in sums]

    def rotations(self, u: Array) -> Array:
        """R of a state: (n_points, d) in m → (n_points, d, d)."""
        f = np.stack([slope @ u for slope in self._slopes], axis=2)
        f += np.eye(u.shape[1])
        to_rotations(f)
        return f

    def at(self, u: Array) -> Callable[[Array], Array]:
        """P of a state (n_points, d) in m: forces in N to displacements in m, (n_points, d)."""
        r, body = self.rotations(u), self._equilibrium

        def respond(force: Array) -> Array:
            unit = float(np.abs(force).max())
            if not 0 < unit < np.inf:
                return np.zeros_like(force)
            back = np.einsum("aji,aj->ai", r, force / unit)
            found = body.linear_response(back[None].astype(np.float32))[0]
            return np.asarray(unit * np.einsum("aij,aj->ai", r, found) * body.free)

        return respond


@compiled
def to_rotations(f: Array) -> None:
    """Replace tensors (n, d, d) by their rotations: Newton's method for the polar decomposition.

    Those that are inverted become 1.
    """
    d = f.shape[1]
    cofactor = np.empty((d, d))
    for of in f:
        for _ in range(POLAR):
            det = 0.0
            for i in range(d):
                for j in range(d):
                    if d == 2:
                        cofactor[i, j] = of[1 - i, 1 - j] * (1 if i == j else -1)
                    else:
                        k, n, m, r = (i + 1) % 3, (i + 2) % 3, (j + 1) % 3, (j + 2) % 3
                        cofactor[i, j] = of[k, m] * of[n, r] - of[k, r] * of[n, m]
                    det += of[i, j] * cofactor[i, j] / d
            if not det > 0:
                for i in range(d):
                    for j in range(d):
                        of[i, j] = 1.0 if i == j else 0.0
                break
            for i in range(d):
                for j in range(d):
                    of[i, j] = (of[i, j] + cofactor[i, j] / det) / 2
