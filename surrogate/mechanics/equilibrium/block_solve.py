r"""The response of a large body on a GPU and in an exported file: block elimination, refined.

Factors of sparse matrices are solved with entry by entry, which neither a GPU nor a file of tensor
operations does well. In the order of its band, K is block tridiagonal; its elimination needs only
the inverses of the Schur complements, which are held in single precision:

.. math::
    S_1 = K_{11}, \quad S_i = K_{ii} - K_{i,i-1} S_{i-1}^{-1} K_{i-1,i}, \qquad
    z_i = S_i^{-1} (f_i - K_{i,i-1} z_{i-1}), \quad x_i = z_i - S_i^{-1} K_{i,i+1} x_{i+1}.

The result has a relative error e of about ε κ(K), too large for slender bodies. Each refinement by
the residual f − K x, computed in double precision, multiplies it by e once more; as many are done
as bring it below what is wanted.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import torch
from scipy.sparse import csr_array
from torch import Tensor, nn

from surrogate.mechanics.equilibrium.out_of_balance import Equilibrium
from surrogate.mechanics.matrices.factors import band_order
from surrogate.mechanics.matrices.sparse_products import SparseProduct
from surrogate.runtime.cuda_graphs import Replayed

MOST_REFINEMENTS = 5
EPSILON = 2.0**-23
ALIGNED = 32  # rows of a block on a GPU are a multiple, so that products read whole lines
PROBES = 4  # random forces, by which errors are measured
FEW = 4  # right-hand sides up to which launching the kernels one by one takes longest
CPU = torch.device("cpu")


class BlockSolve(nn.Module):
    """Forces in N to displacements in m, as `Compliance`: (N, n_points, d) → same.

    Parameters
    ----------
    equilibrium : Equilibrium
        A factor of K(0) is not needed.
    device : torch.device
    accuracy : float
        Relative error of a response.
    least : int
        Smallest number of rows of a block.

    Attributes
    ----------
    dofs : Tensor of int, (n,)
        Degrees of freedom, point · d + component, in the order of the blocks.
    refinements : int
    """

    dofs: Tensor

    def __init__(
        self,
        equilibrium: Equilibrium,
        device: torch.device = CPU,
        accuracy: float = EPSILON,
        least: int = 1,
    ) -> None:
        super().__init__()
        geometry = equilibrium.geometry
        dofs, size = band_order(geometry.coordinates, geometry.cells, geometry.held)
        k, size = equilibrium.stiffness(dofs), max(size, least)
        if device.type == "cuda":
            size = -(-size // ALIGNED) * ALIGNED
        self.starts = list(range(0, len(dofs), size))
        self.register_buffer("dofs", torch.from_numpy(dofs).to(device), persistent=False)
        self.stiffness = SparseProduct(k, torch.float64).to(device)
        self.before, self.after = nn.ModuleList(), nn.ModuleList()
        schur = torch.zeros(0, 0)
        for number, start in enumerate(self.starts):
            rows = slice(start, start + size)
            block = sparse_tensor(k[rows, rows]).to(device).to_dense()
            if number:
                to_last = k[rows, start - size : start]
                block -= _congruent(sparse_tensor(to_last).to(device), schur)
                self.before.append(SparseProduct(to_last, torch.float32).to(device))
                self.after.append(SparseProduct(to_last.T.tocsr(), torch.float32).to(device))
            schur = torch.linalg.inv(block)
            self.register_buffer(f"inverse_{number}", schur.float(), persistent=False)
        self._graph = Replayed(self._refined)
        self.refinements = 0
        self.refinements = self._needed(accuracy)

    def _needed(self, accuracy: float) -> int:
        """Number of refinements after which the next one changes a response too little."""
        probes = np.random.default_rng(0).normal(size=(len(self.dofs), PROBES))
        f = torch.from_numpy(probes).to(self.dofs.device)
        x = self._eliminated(f)
        for count in range(MOST_REFINEMENTS):
            change = self._eliminated(f - self.stiffness(x))
            if change.norm() <= accuracy * x.norm():
                return count
            x = x + change
        return MOST_REFINEMENTS

    def forward(self, force: Tensor) -> Tensor:
        """Respond."""
        return at_dofs(force.double(), self.dofs, lambda f: self.solve(f.T).T).to(force.dtype)

    def solve(self, right: Tensor) -> Tensor:
        """K⁻¹ of columns at `dofs`, in double precision: (n, N) → same."""
        if torch.compiler.is_compiling() or right.shape[1] > FEW:  # a file has any number
            return self._refined(right.double())[0]
        return self._graph(right.double())[0]

    def _refined(self, right: Tensor) -> tuple[Tensor]:
        x = self._eliminated(right)
        for _ in range(self.refinements):
            x = x + self._eliminated(right - self.stiffness(x))
        return (x,)

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

    def __deepcopy__(self, _: object) -> BlockSolve:
        return self  # nothing in it changes


def at_dofs(force: Tensor, dofs: Tensor, solve: Callable[[Tensor], Tensor]) -> Tensor:
    """Solve at some degrees of freedom, (N, n) → same, of fields (N, n_points, d) → same."""
    flat = force.flatten(1)
    found = solve(flat.index_select(1, dofs))
    return torch.zeros_like(flat).index_copy(1, dofs, found).reshape(force.shape)


def _congruent(matrix: Tensor, symmetric: Tensor) -> Tensor:
    """A S Aᵀ of a sparse A."""
    return torch.sparse.mm(matrix, torch.sparse.mm(matrix, symmetric).T)


def sparse_tensor(matrix: csr_array) -> Tensor:
    """The matrix as a sparse tensor in double precision."""
    entries = matrix.tocoo()
    places = torch.from_numpy(np.stack(entries.coords).astype(np.int64))
    told = torch.sparse.check_sparse_tensor_invariants(True)  # type: ignore[no-untyped-call]
    with told:  # it warns otherwise
        return torch.sparse_coo_tensor(places, torch.from_numpy(entries.data), matrix.shape)
