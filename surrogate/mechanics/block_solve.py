r"""The response of a large body in an exported file: block elimination, refined.

Neither K⁻¹ nor a factor in double precision of a large body fits into a file of some ten megabytes.
In the order of its band, K is block tridiagonal; its elimination needs only the inverses of the
Schur complements, which are held in single precision:

.. math::
    S_1 = K_{11}, \quad S_i = K_{ii} - K_{i,i-1} S_{i-1}^{-1} K_{i-1,i}, \qquad
    z_i = S_i^{-1} (f_i - K_{i,i-1} z_{i-1}), \quad x_i = z_i - S_i^{-1} K_{i,i+1} x_{i+1}.

The result has a relative error e of about ε κ(K), too large for slender bodies. Each refinement by
the residual f − K x, computed in double precision, multiplies it by e once more; as many are done
as bring it below ε.
"""

from __future__ import annotations

import numpy as np
import torch
from scipy.sparse import csr_array
from torch import Tensor, nn

from shared_schema.common.errors import InputError
from surrogate.mechanics.band_matrix import BandCholesky
from surrogate.mechanics.compliance import Compliance
from surrogate.mechanics.weighted_sums import padded_rows

MOST_REFINEMENTS = 5
EPSILON = 2.0**-23
PROBES = 4  # random forces, by which errors are measured


class SparseProduct(nn.Module):
    """Product with a sparse matrix: (columns, N) → (rows, N).

    Few operations, since a file of many takes minutes to write.
    """

    columns: Tensor
    weights: Tensor

    def __init__(self, matrix: csr_array, dtype: torch.dtype) -> None:
        super().__init__()
        columns, weights = padded_rows(matrix)
        self.shape = columns.T.shape
        flat = torch.from_numpy(columns.T.astype(np.int32).flatten())
        self.register_buffer("columns", flat, persistent=False)
        values = torch.from_numpy(weights.T).to(dtype)[:, :, None]
        self.register_buffer("weights", values, persistent=False)

    def forward(self, x: Tensor) -> Tensor:
        """Multiply."""
        terms = x.index_select(0, self.columns).reshape(*self.shape, -1)
        return (terms * self.weights).sum(0)


class BlockSolve(nn.Module):
    """Forces on the free nodes in N to displacements in m, as `Compliance`: (N, d · n_free) → same.

    Parameters
    ----------
    compliance : Compliance
        Compliance of a large body.

    Raises
    ------
    InputError
        If the stiffness of the body is not stored as a band.

    Attributes
    ----------
    refinements : int
    """

    free_nodes: Tensor
    order: Tensor
    place: Tensor

    def __init__(self, compliance: Compliance) -> None:
        super().__init__()
        if not isinstance(compliance.factor, BandCholesky):
            raise InputError(
                f"the stiffness of {len(compliance.order)} degrees of freedom is too large for an "
                "exported file, expected a smaller body"
            )
        k, size = compliance.stiffness, compliance.factor.width
        places = np.full(compliance.size, len(compliance.order))  # that of a zero, if held
        places[compliance.order] = np.arange(len(compliance.order))
        self.starts = list(range(0, k.shape[0], size))
        self.register_buffer("free_nodes", compliance.free_nodes, persistent=False)
        self.register_buffer("order", torch.from_numpy(compliance.order), persistent=False)
        place = torch.from_numpy(places)
        self.register_buffer("place", place, persistent=False)
        self.stiffness = SparseProduct(k, torch.float64)
        self.before, self.after = nn.ModuleList(), nn.ModuleList()
        schur = np.zeros((0, 0))
        for number, start in enumerate(self.starts):
            rows = slice(start, start + size)
            block = k[rows, rows].toarray()
            if number:
                to_last = k[rows, start - size : start]
                block -= to_last @ schur @ to_last.T
                self.before.append(SparseProduct(to_last, torch.float32))
                self.after.append(SparseProduct(to_last.T.tocsr(), torch.float32))
            schur = np.linalg.inv(block)
            inverse = torch.from_numpy(schur).float()
            self.register_buffer(f"inverse_{number}", inverse, persistent=False)
        self.refinements = self._needed(compliance)

    def _needed(self, compliance: Compliance) -> int:
        """Number of refinements after which the error is below the rounding of a number."""
        force = np.random.default_rng(0).normal(size=(PROBES, compliance.size))
        expected = torch.from_numpy(compliance.solve(force)[:, compliance.order].T)
        f = torch.from_numpy(force[:, compliance.order].T)
        x = self._eliminated(f)
        for count in range(MOST_REFINEMENTS):
            if (x - expected).norm() <= EPSILON * expected.norm():
                return count
            x = x + self._eliminated(f - self.stiffness(x))
        return MOST_REFINEMENTS

    def forward(self, force: Tensor) -> Tensor:
        """Respond."""
        f = force.double().T.index_select(0, self.order)
        x = self._eliminated(f)
        for _ in range(self.refinements):
            x = x + self._eliminated(f - self.stiffness(x))
        if len(self.place) > len(x):
            x = torch.cat([x, x.new_zeros(1, x.shape[1])])
        return x.index_select(0, self.place).T.to(force.dtype)

    def _eliminated(self, f: Tensor) -> Tensor:
        """Solve by elimination in single precision: (n, N) → same, in double precision."""
        ends = [*self.starts[1:], len(f)]
        single = f.float()
        parts: list[Tensor] = []
        for number, (start, end) in enumerate(zip(self.starts, ends, strict=True)):
            right = single[start:end]
            if number:
                right = right - self.before[number - 1](parts[-1])
            parts.append(self._inverse(number) @ right)
        for number in reversed(range(len(parts) - 1)):
            moved = self.after[number](parts[number + 1])
            parts[number] = parts[number] - self._inverse(number) @ moved
        return torch.cat(parts).double()

    def _inverse(self, number: int) -> Tensor:
        return self.get_buffer(f"inverse_{number}")
