"""Gradients at the quadrature points of the cells, and forces of stresses there."""

from __future__ import annotations

import numpy as np
import torch
from scipy.sparse import csr_array
from torch import Tensor, nn

from shared_schema.material import NeoHookean
from surrogate.data.geometry import Geometry
from surrogate.mechanics.block_solve import SparseProduct


class CellOperators(nn.Module):
    """Gradients of displacements at the quadrature points, and forces of stresses there.

    Fields are (N, d, n_nodes), displacements in m and forces in N.

    Parameters
    ----------
    geometry : Geometry
    material : NeoHookean
    gradients : Tensor, (n_cells, n_points, n_corners, d)
        Of the shape functions; their precision is that of all fields.
    volumes : Tensor, (n_cells, n_points)
    """

    cells: Tensor
    slopes: Tensor
    weighted: Tensor
    volumes: Tensor

    def __init__(
        self, geometry: Geometry, material: NeoHookean, gradients: Tensor, volumes: Tensor
    ) -> None:
        super().__init__()
        self.material = material
        cells = torch.from_numpy(geometry.cells)
        self.register_buffer("cells", cells, persistent=False)
        count, points, corners, d = gradients.shape
        slopes = gradients.permute(0, 2, 1, 3).reshape(count, corners, points * d)
        weighted = (gradients * volumes[:, :, None, None]).permute(0, 1, 3, 2)
        self.register_buffer("slopes", slopes, persistent=False)
        self.register_buffer(
            "weighted", weighted.reshape(count, points * d, corners), persistent=False
        )
        self.register_buffer("volumes", volumes.flatten(), persistent=False)
        nodes, places = geometry.cells.ravel(), np.arange(geometry.cells.size)
        shape = len(geometry.coordinates), geometry.cells.size
        incidence = csr_array((np.ones(geometry.cells.size), (nodes, places)), shape)
        self.sums = SparseProduct(incidence, gradients.dtype)

    def gradient(self, u: Tensor) -> Tensor:
        """∂u_i/∂x_j at the quadrature points: (N, d, n_nodes) → (N, d, d, n_points)."""
        count, corners, columns = self.slopes.shape
        samples, d, _ = u.shape
        rows = u.flatten(0, 1).T.contiguous()  # whole rows are fast to select
        at_corners = rows.index_select(0, self.cells.flatten()).reshape(count, corners, -1)
        h = torch.bmm(at_corners.transpose(1, 2), self.slopes)
        h = h.reshape(count, samples, d, columns // d, d)
        return h.permute(1, 2, 4, 0, 3).flatten(3)

    def forces(self, p: Tensor) -> Tensor:
        """Forces of stresses: (N, d, d, n_points) → (N, d, n_nodes).

        Every node sums what its cells have. ONNX Runtime would scatter what the cells have to the
        nodes on several threads, and lose some of it (its issue 18048).
        """
        samples, d, _, _ = p.shape
        count, columns, corners = self.weighted.shape
        flat = p.reshape(samples, d, d, count, columns // d).permute(3, 0, 1, 4, 2)
        at_corners = torch.bmm(flat.reshape(count, samples * d, columns), self.weighted)
        rows = at_corners.transpose(1, 2).reshape(count * corners, samples * d)
        sums: Tensor = self.sums(rows)
        return sums.T.reshape(samples, d, sums.shape[0])
