r"""The response of a large body in an exported file: block elimination, refined.

Neither K⁻¹ nor a factor in double precision of a large body fits into a file of some ten megabytes.
In the order of its band, K is block tridiagonal; its elimination needs only the inverses of the
Schur complements, which are held in single precision:

.. math::
    S_1 = K_{11}, \quad S_i = K_{ii} - K_{i,i-1} S_{i-1}^{-1} K_{i-1,i}, \qquad
    z_i = S_i^{-1} (f_i - K_{i,i-1} z_{i-1}), \quad x_i = z_i - S_i^{-1} K_{i,i+1} x_{i+1}.

The result has a relative error e of about ε κ(K), too large for slender bodies. Each refinement by
the residual f − K x, computed in double precision, multiplies it by e once more.
"""

from __future__ import annotations

import numpy as np
import torch
from scipy.sparse import csr_array
from torch import Tensor, nn

from surrogate.mechanics.compliance import Compliance
from surrogate.networks.weighted_sums import WeightedSums, padded_rows

REFINEMENTS = 3


def product(matrix: csr_array, dtype: torch.dtype) -> WeightedSums:
    """Product with a sparse matrix, (N, columns) → (N, rows); columns in 32 bits."""
    columns, weights = padded_rows(matrix)
    return WeightedSums(columns.astype(np.int32), weights, dtype)


class BlockSolve(nn.Module):
    """Forces on the free nodes in N to displacements in m, as `Compliance`: (N, d · n_free) → same.

    Parameters
    ----------
    compliance : Compliance
        Compliance of a large body.
    """

    free_nodes: Tensor
    order: Tensor
    place: Tensor

    def __init__(self, compliance: Compliance) -> None:
        super().__init__()
        assert compliance.factor is not None
        k, size = compliance.stiffness, compliance.factor.width
        places = np.full(compliance.size, len(compliance.order))  # that of a zero, if held
        places[compliance.order] = np.arange(len(compliance.order))
        self.starts = list(range(0, k.shape[0], size))
        self.register_buffer("free_nodes", compliance.free_nodes, persistent=False)
        self.register_buffer("order", torch.from_numpy(compliance.order), persistent=False)
        place = torch.from_numpy(places)
        self.register_buffer("place", place, persistent=False)
        self.stiffness = product(k, torch.float64)
        self.before, self.after = nn.ModuleList(), nn.ModuleList()
        schur = np.zeros((0, 0))
        for number, start in enumerate(self.starts):
            rows = slice(start, start + size)
            block = k[rows, rows].toarray()
            if number:
                to_last = k[rows, start - size : start]
                block -= to_last @ schur @ to_last.T
                self.before.append(product(to_last, torch.float32))
                self.after.append(product(to_last.T.tocsr(), torch.float32))
            schur = np.linalg.inv(block)
            inverse = torch.from_numpy(schur).float()
            self.register_buffer(f"inverse_{number}", inverse, persistent=False)

    def forward(self, force: Tensor) -> Tensor:
        """Respond."""
        f = force.double().index_select(1, self.order)
        x = self._eliminated(f)
        for _ in range(REFINEMENTS):
            x = x + self._eliminated(f - self.stiffness(x))
        if len(self.place) > x.shape[1]:
            x = torch.cat([x, x.new_zeros(len(x), 1)], dim=1)
        return x.index_select(1, self.place).to(force.dtype)

    def _eliminated(self, f: Tensor) -> Tensor:
        """Solve by elimination in single precision: (N, n) → same, in double precision."""
        ends = [*self.starts[1:], f.shape[1]]
        parts: list[Tensor] = []
        for number, (start, end) in enumerate(zip(self.starts, ends, strict=True)):
            right = f[:, start:end].float()
            if number:
                right = right - self.before[number - 1](parts[-1])
            parts.append(right @ self._inverse(number))
        for number in reversed(range(len(parts) - 1)):
            moved = self.after[number](parts[number + 1])
            parts[number] = parts[number] - moved @ self._inverse(number)
        return torch.cat(parts, dim=1).double()

    def _inverse(self, number: int) -> Tensor:
        inverse: Tensor = getattr(self, f"inverse_{number}")
        return inverse
