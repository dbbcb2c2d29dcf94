r"""The linear surrogate of Deshpande et al. (2022), Table "CNN_MLP": one dense layer, no bias.

.. math:: u = W f, \qquad W_0 = K^{-1}

u and f contain the free degrees of freedom, and K is the stiffness of the undeformed body. So the
untrained layer is linear elasticity. (The paper's layer also contains the clamped degrees of
freedom; their rows and columns are zero.)
"""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.sparse import csr_array
from torch import Tensor, nn
from torch.nn import functional

from shared_schema.stiffness import Stiffness
from surrogate.learning.networks.field_network import at_points, on_grid


class LinearMap(nn.Module):
    """Linear map from scaled forces to scaled displacements, both (N, d, nx, ny[, nz]).

    Parameters
    ----------
    dimension : int
        Number of space dimensions d.
    free : Tensor of bool, (nx, ny[, nz])
        True at grid points that are nodes and not clamped.

    Attributes
    ----------
    weight : nn.Parameter, (d · n_free, d · n_free)
        Matrix W, ordered component by component; zero until `start_at` is called.
    """

    points: Tensor

    def __init__(self, dimension: int, free: Tensor) -> None:
        super().__init__()
        points = free.flatten().nonzero().squeeze(1)
        self.register_buffer("points", points, persistent=False)
        self.weight = nn.Parameter(torch.zeros(2 * (dimension * len(points),)))

    @torch.no_grad()
    def start_at(self, compliance: Tensor, force_unit: Tensor, displacement_unit: Tensor) -> None:
        """Set the weights to a compliance matrix.

        Parameters
        ----------
        compliance : Tensor, (d · n_free, d · n_free)
            Compliance matrix in m/N.
        force_unit : Tensor, ()
            Unit of the scaled forces, in N.
        displacement_unit : Tensor, (d, nx, ny[, nz])
            Unit of the scaled displacements, in m.
        """
        units = displacement_unit.flatten(1)[:, self.points].flatten().double()
        self.weight.copy_(compliance * (force_unit.double() / units)[:, None])

    def forward(self, force: Tensor) -> Tensor:
        """Predict scaled displacements from scaled forces."""
        displacement = functional.linear(at_points(force, self.points), self.weight)
        return on_grid(displacement, self.points, force)


def compliance_of(
    stiffness: Stiffness, nodes: NDArray[np.int64], free: NDArray[np.bool_]
) -> Tensor:
    """Return K⁻¹ in m/N of the degrees of freedom of some nodes, by component, then by node.

    It is zero at components that are held.

    Parameters
    ----------
    stiffness : Stiffness
        Stiffness of the whole body without supports.
    nodes : array of int, (n_free,)
        Nodes that can move, in the order of the result; all others are held.
    free : array of bool, (n_nodes, d)
        Components of all nodes of the body that are not held.
    """
    d = free.shape[1]
    dofs = (nodes * d + np.arange(d)[:, None]).ravel()
    moving = torch.from_numpy(np.flatnonzero(free.ravel()[dofs]))
    dofs = dofs[moving]
    k = csr_array((stiffness.data, stiffness.indices, stiffness.indptr))[dofs][:, dofs]
    inverse = torch.cholesky_inverse(torch.linalg.cholesky(torch.from_numpy(k.toarray())))
    whole = inverse.new_zeros(2 * (nodes.size * d,))
    whole[moving[:, None], moving] = inverse
    return whole
