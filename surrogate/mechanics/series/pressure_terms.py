r"""Power series of the forces of pressures that follow the surface of a body.

With the tangents :math:`t_1, t_2` of a facet, which are linear in the positions, the forces

.. math:: f_a(x) = -p \sum_q w_q N_a \, t_1(x) × t_2(x)

(`shared_schema.common.bodies.distributed_loads`) are polynomials of the displacement: under s p on
:math:`x_0 + \sum_k s^k u_k`, with the undeformed body's :math:`x_0` and :math:`x_k = u_k`, their
terms are

.. math:: f_{a,k} = -p \sum_q w_q N_a \sum_{i+j=k-1} t_1(x_i) × t_2(x_j).

In the plane there is one tangent, which is turned by 90°: i is 0.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.sparse import csr_array
from torch import Tensor, nn

from shared_schema.common.bodies.distributed_loads import shape_functions
from surrogate.mechanics.equilibrium.follower_pressure import FollowerPressure
from surrogate.mechanics.matrices.sparse_products import SparseProduct

Array = NDArray[np.float64]
CPU = torch.device("cpu")


class PressedFacets(nn.Module):
    """Facets of some surfaces of a body; its fields are (N, n_points, d).

    Parameters
    ----------
    coordinates : array, (n_points, d)
        Positions of the undeformed body's points in m.
    surfaces : sequence of array of int, (n_facets, n_corners)
        Facets of every surface, seen from outside.
    """

    facets: Tensor
    at_rest: Tensor
    weighted: Tensor
    gradients: Tensor
    surface: Tensor

    def __init__(self, coordinates: Array, surfaces: Sequence[NDArray[np.int64]]) -> None:
        super().__init__()
        facets, d = np.concatenate(list(surfaces)), coordinates.shape[1]
        values, gradients, weights = shape_functions(facets.shape[1], d)
        sizes = [len(surface) for surface in surfaces]
        for name, array in (
            ("facets", facets),
            ("weighted", weights[:, None] * values),
            ("gradients", gradients),
            ("surface", np.repeat(np.arange(len(sizes)), sizes)),
        ):
            self.register_buffer(name, torch.tensor(array), persistent=False)
        at_rest = self.tangents(torch.tensor(coordinates[None]))
        self.register_buffer("at_rest", at_rest, persistent=False)
        rows, shape = facets.ravel(), (len(coordinates), facets.size)
        incidence = csr_array((np.ones(facets.size), (rows, np.arange(facets.size))), shape)
        self.sums = SparseProduct(incidence, torch.float64)

    @classmethod
    def of(
        cls, pressure: FollowerPressure | None, device: torch.device = CPU
    ) -> tuple[PressedFacets, Tensor] | tuple[None, None]:
        """Facets and pressures, (N, n_surfaces) in Pa, of some load cases; None if all are 0."""
        if pressure is None or not pressure.pressures.any():
            return None, None
        facets = cls(pressure.coordinates, pressure.surfaces)
        return facets.to(device), torch.tensor(pressure.pressures, device=device)

    def tangents(self, u: Tensor) -> Tensor:
        """Tangents of the facets: (N, n_points, d) in m → (N, n_facets, n_quadrature, d - 1, d)."""
        return torch.einsum("qat,nfad->nfqtd", self.gradients, self._of_facets(u))

    def term(self, pressures: Tensor, u: Sequence[Tensor]) -> Tensor:
        """Forces in N of the order after that of the last of some terms u₁, u₂, … in m.

        Pressures are (N, n_surfaces) in Pa.
        """
        tangents, k = [self.at_rest, *map(self.tangents, u)], len(u)
        normals = cross(tangents[0], tangents[k])
        for i in range(1, k + 1) if normals.shape[-1] == 3 else ():
            normals = normals + cross(tangents[i], tangents[k - i])
        normals = self._pushing(pressures)[:, :, None, None] * normals
        of_facets = torch.einsum("qa,nfqd->fand", self.weighted, normals)
        sums: Tensor = self.sums(of_facets.flatten(0, 1).flatten(1))
        return sums.reshape(len(sums), *normals.shape[::3]).transpose(0, 1)

    def works(self, pressures: Tensor, u: Sequence[Tensor]) -> Tensor:
        r"""Works :math:`-p \sum_q w_q (t_1(x_i) × t_2(x_j)) · u_m` of n terms in J.

        (N, n + 1, n + 1, n) of i, j, m.
        """
        of_terms = torch.stack([self.tangents(each) for each in u], 1)
        tangents = torch.cat(
            [self.at_rest.expand(u[0].shape[0], 1, *of_terms.shape[2:]), of_terms], 1
        )
        moved = [torch.einsum("qa,nfad->nfqd", self.weighted, self._of_facets(each)) for each in u]
        moved_by = self._pushing(pressures)[:, None, :, None, None] * torch.stack(moved, 1)
        rows = []
        for i in range(tangents.shape[1]):
            normals = cross(tangents[:, i : i + 1], tangents)
            of_row = torch.einsum("njfqd,nmfqd->njm", normals, moved_by)
            rows.append(of_row if i == 0 or normals.shape[-1] == 3 else 0 * of_row)
        return torch.stack(rows, 1)

    def _of_facets(self, u: Tensor) -> Tensor:
        """Fields at the points of the facets: (N, n_points, d) → (N, n_facets, n, d)."""
        rows = u.index_select(1, self.facets.flatten())
        return rows.reshape(-1, *self.facets.shape, u.shape[2])

    def _pushing(self, pressures: Tensor) -> Tensor:
        """−p of every facet: (N, n_surfaces) → (N, n_facets)."""
        return -pressures.index_select(1, self.surface)


def cross(a: Tensor, b: Tensor) -> Tensor:
    """First tangent of A × second one of B; in the plane, the tangent of B turned: (…, d)."""
    if b.shape[-1] == 3:
        return torch.linalg.cross(a[..., 0, :], b[..., 1, :], dim=-1)
    t = b[..., 0, :]
    return torch.stack([t[..., 1], -t[..., 0]], -1)
