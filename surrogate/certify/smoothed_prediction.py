r"""A prediction without the few cells that it inverts: their nodes follow those around.

.. math:: Δu = 0 \text{ in the patch}, \qquad u \text{ as predicted around it}, \qquad
    ∇u · n = \bar H · n \text{ on the surface of the body}

The patch is the inverted cells, or these with the cells around, up to three times: that of lowest
potential energy, which is infinite while a cell is inverted and large while one almost is.
:math:`\bar H` is the median of ∇u over the cells next to it. Δ is that of the finite elements, so
that a patch that is only turned and stretched is exact.
"""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.sparse import csc_array
from scipy.sparse.linalg import splu

from surrogate.mechanics.matrices.cell_matrices import sum_of_cells
from surrogate.mechanics.out_of_balance import Equilibrium
from surrogate.mechanics.solids.deformation import determinant

Array = NDArray[np.float64]
FEW = 0.3  # of the cells, beyond which a prediction is wrong as a whole
GROWTHS = 3  # of the patch


def smoothed(equilibrium: Equilibrium, load: Array, predicted: Array) -> Array | None:
    """Smooth a prediction where it inverts cells.

    Parameters
    ----------
    equilibrium : Equilibrium
    load, predicted : array, (1, n_nodes, d)
        Nodal forces in N; displacements in m, zero where they are held.

    Returns
    -------
    array of the same shape, or None
        None if three in ten cells are inverted, or some still are.
    """
    solid = equilibrium.solid
    f = solid.deformation_gradient(torch.from_numpy(predicted))
    j = determinant(f)
    patch = ~((j > 0) & (j < torch.inf)).all(dim=2)[:, 0].numpy()
    cells = solid.cells.numpy()
    if patch.mean() > FEW or not np.isfinite(predicted).all():
        return None
    laplacian, outward = laplacian_of(equilibrium)
    volumes, best, lowest = solid.volumes.numpy(), None, np.inf
    slopes = np.einsum("ijcq,cq->cij", f[:, :, :, 0].numpy(), volumes)
    slopes = slopes / volumes.sum(axis=1)[:, None, None] - np.eye(len(f))
    for _ in range(GROWTHS + 1):
        nodes = np.unique(cells[patch])
        touching = np.asarray(np.isin(cells, nodes).any(axis=1))
        beside = slopes[touching & ~patch]
        slope = np.median(beside, axis=0) if len(beside) else np.zeros_like(slopes[0])
        u = predicted.copy()
        for component, free in enumerate(equilibrium.free.T):
            inner = nodes[free[nodes]]
            outer = np.setdiff1d(np.arange(solid.nodes), inner)
            if len(inner):
                sides = outward[inner] @ slope[component]
                sides -= laplacian[inner][:, outer] @ predicted[0, outer, component]
                factor = splu(csc_array(laplacian[inner][:, inner]))
                u[0, inner, component] = factor.solve(sides)
        potential = float(equilibrium.potential(u, load)[0])
        if potential < lowest:
            best, lowest = u, potential
        patch = touching
    return best


def laplacian_of(equilibrium: Equilibrium) -> tuple[csc_array, Array]:
    """−Δ of the finite elements, and ∫ ∇N_a, which only nodes of the surface have.

    Returns
    -------
    csc_array, (n_nodes, n_nodes)
    array, (n_nodes, d)
    """
    solid = equilibrium.solid
    gradients, volumes = solid.gradients.numpy(), solid.volumes.numpy()
    cells = solid.cells.numpy()
    values = np.einsum("cq,cqaj,cqbj->cab", volumes, gradients, gradients)
    matrix = csc_array(sum_of_cells(values, cells, solid.nodes))
    outward = np.zeros((solid.nodes, gradients.shape[3]))
    np.add.at(outward, cells, np.einsum("cq,cqaj->caj", volumes, gradients))
    return matrix, outward
