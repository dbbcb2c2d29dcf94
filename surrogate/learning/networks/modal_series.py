r"""The load series in modes: polynomials in the coefficients of the linear response.

.. math::
    s_2(a) = \sum_{i ≤ j} A_{ij} \, a_i a_j, \qquad
    s_3(a) = \sum_{i ≤ j ≤ k} B_{ijk} \, a_i a_j a_k

The terms u₂ and u₃ of the series of the displacement in the load
(`surrogate.series.third_order`) are exactly of these forms if all modes are used. A and B
are fitted to them by least squares, over training loads and over the leading modes; what the loads
do outside the leading modes is accounted for as far as these tell it.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations_with_replacement

import torch
from torch import Tensor, nn

from surrogate.learning.networks.modes import half_whitening

SECOND = 2  # lowest order
PENALTY = 1e-8  # on squared coefficients, relative to the mean square of the monomials


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
