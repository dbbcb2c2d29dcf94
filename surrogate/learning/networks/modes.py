r"""Leading modes of fields on the grid, and the load series in modes.

The series is one of polynomials in the coefficients of the linear response,

.. math::
    s_2(a) = \sum_{i ≤ j} A_{ij} \, a_i a_j, \qquad
    s_3(a) = \sum_{i ≤ j ≤ k} B_{ijk} \, a_i a_j a_k

The terms u₂ and u₃ of the series of the displacement in the load
are exactly of these forms if all modes are used. A and B
are fitted to them by least squares, over training loads and over the leading modes; what the loads
do outside the leading modes is accounted for as far as these tell it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import combinations_with_replacement

import torch
from torch import Tensor, nn

from surrogate.learning.networks.field_network import at_points, on_grid

LARGEST_SVD = 2000  # samples; of more, a random part is decomposed
POWER_ITERATIONS, SPARE_MODES = 4, 20
SECOND = 2  # lowest order
PENALTY = 1e-8  # on squared coefficients, relative to the mean square of the monomials


def chosen_rows(count: int, seed: int, largest: int) -> Tensor:
    """Return random rows of some samples, `largest` at most, sorted."""
    generator = torch.Generator().manual_seed(seed)
    return torch.randperm(count, generator=generator)[:largest].sort().values


def modal_encoder(
    respond: Callable[[Tensor], Tensor],
    linear: Tensor,
    points: Tensor,
    count: int,
    force_scale: Tensor,
    seed: int,
) -> Tensor:
    """Return (S Φ)ᵀ of the leading modes Φ of linear responses, (count, d · n_points), scaled.

    It takes scaled forces at the points to scaled coefficients (`half_whitening`).

    Parameters
    ----------
    respond : callable
        Linear response S on the grid: forces in N to displacements in m.
    linear : Tensor, (N, d, nx, ny[, nz])
        Linear responses of the training samples, in m.
    points : Tensor of int, (n_points,)
        Numbers of the points, in the flattened grid, that are nodes and not clamped.
    count : int
        Number of modes.
    force_scale : Tensor, ()
        Unit of the scaled forces, in N.
    seed : int
    """
    snapshots = at_points(linear[chosen_rows(len(linear), seed, LARGEST_SVD)], points)
    modes = leading_modes(snapshots, count, seed)
    scales = half_whitening(snapshots @ modes.T)
    responses = respond(on_grid(modes, points, linear[: len(modes)]))
    return at_points(responses, points) * (force_scale * scales[:, None])


def leading_modes(snapshots: Tensor, count: int, seed: int) -> Tensor:
    """Return leading orthonormal modes of some snapshots, (count, n), not centred.

    Parameters
    ----------
    snapshots : Tensor, (N, n)
    count : int
        Number of modes, at most N and n.
    seed : int
        Seed of the randomised decomposition of a large matrix.
    """
    if min(snapshots.shape) <= 4 * count:
        return torch.linalg.svd(snapshots, full_matrices=False).Vh[:count].contiguous()
    from sklearn.utils.extmath import randomized_svd

    _, _, modes = randomized_svd(
        snapshots.numpy(),
        count,
        n_oversamples=SPARE_MODES,
        n_iter=POWER_ITERATIONS,
        random_state=seed % 2**32,
    )
    return torch.from_numpy(modes)


def half_whitening(values: Tensor) -> Tensor:
    """Factors that divide every column by the square root of its root mean square: (N, n) → (n,).

    The scaled values have a root mean square of 1 over all columns. Large and small columns differ
    by the square root of what they did: less than before, but the small ones, which samples tell
    less about, do not become as large as the others.
    """
    mean_square = values.square().mean(dim=0)
    factors = mean_square.clamp(min=torch.finfo(values.dtype).tiny).pow(-0.25)
    factors = torch.where(mean_square > 0, factors, torch.zeros_like(factors))
    overall = (values * factors).square().mean().sqrt()
    return torch.where(overall > 0, factors / overall, torch.ones_like(factors))


class ModalSeries(nn.Module):
    """Terms of second and higher order: (N, input_modes) → list of (N, output_modes).

    They are zero until `fit`.

    Parameters
    ----------
    modes : sequence of int
        Number of leading input modes in the products of two, of three, and so on.
    outputs : int
        Number of output modes.

    Attributes
    ----------
    coefficients : list of Tensor, (n_monomials, outputs)
        A, B, in units of the output modes.
    input_scales : Tensor, (len(modes), outputs)
        Factors on the terms as inputs of a network (`half_whitening`).
    """

    input_scales: Tensor

    def __init__(self, modes: Sequence[int], outputs: int) -> None:
        super().__init__()
        self.orders = range(SECOND, SECOND + len(modes))
        for order, count in zip(self.orders, modes, strict=True):
            factors = torch.tensor(list(combinations_with_replacement(range(count), order)))
            self.register_buffer(f"factors_{order}", factors.T.contiguous(), persistent=False)
            self.register_buffer(f"coefficients_{order}", torch.zeros(len(factors), outputs))
        self.register_buffer("input_scales", torch.ones(len(modes), outputs))

    @property
    def coefficients(self) -> list[Tensor]:
        """Coefficients of every order."""
        return [self.get_buffer(f"coefficients_{order}") for order in self.orders]

    @torch.no_grad()
    def fit(self, a: Tensor, terms: Sequence[Tensor]) -> None:
        """Fit the polynomials to terms (N, outputs) under loads with coefficients a."""
        for order, term in zip(self.orders, terms, strict=True):
            monomials = self._monomials(a.double(), order)
            gram = monomials.T @ monomials
            penalty = PENALTY * gram.diagonal().mean() + torch.finfo(gram.dtype).tiny
            gram.diagonal().add_(penalty)
            found = torch.linalg.solve(gram, monomials.T @ term.double())
            self.get_buffer(f"coefficients_{order}").copy_(found)
        scales = [half_whitening(term) for term in self(a)]
        self.input_scales.copy_(torch.stack(scales))

    @torch.no_grad()
    def in_units_of(self, unit: Tensor) -> None:
        """Change the unit of the output modes' coefficients; the scaled terms stay as they are."""
        for coefficients in self.coefficients:
            coefficients /= unit
        self.input_scales *= unit

    def forward(self, a: Tensor) -> list[Tensor]:
        """Evaluate the terms."""
        return [
            self._monomials(a, order) @ coefficients
            for order, coefficients in zip(self.orders, self.coefficients, strict=True)
        ]

    def scaled(self, terms: Sequence[Tensor]) -> list[Tensor]:
        """Scale the terms as inputs of a network."""
        return [term * scale for term, scale in zip(terms, self.input_scales.unbind(), strict=True)]

    def _monomials(self, a: Tensor, order: int) -> Tensor:
        """Products of coefficients: (N, input_modes) → (N, n_monomials)."""
        first, *others = self.get_buffer(f"factors_{order}").unbind()
        product = a.index_select(1, first)
        for factor in others:
            product = product * a.index_select(1, factor)
        return product
