"""Factor on standard deviations that depends on the number of loaded nodes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import torch
from torch import Tensor, nn

KNOTS = 4


class LoadCountFactor(nn.Module):
    r"""Piecewise linear factor c(n), constant beyond its first and its last knot.

    .. math:: c(n) = c_1 + \sum_k (c_{k+1} - c_k)
       \min(\max((n - n_k) / (n_{k+1} - n_k), 0), 1)

    Attributes
    ----------
    counts : Tensor, (KNOTS,)
        Numbers of loaded nodes n_k, ascending; the last one repeated if there are fewer.
    values : Tensor, (KNOTS,)
        Factors c_k; 1 before `set`.
    """

    counts: Tensor
    values: Tensor

    def __init__(self) -> None:
        super().__init__()
        for name in ("counts", "values"):
            self.register_buffer(name, torch.ones(KNOTS))

    def _load_from_state_dict(self, state: dict[str, Any], prefix: str, *others: Any) -> None:
        for name in ("counts", "values"):  # runs without such factors
            state.setdefault(prefix + name, torch.ones(KNOTS))
        super()._load_from_state_dict(state, prefix, *others)

    def set(self, counts: Sequence[float], values: Sequence[float]) -> None:
        """Set the knots, `KNOTS` at most; their numbers of nodes differ by 1 at least."""
        for buffer, given in ((self.counts, counts), (self.values, values)):
            padded = [*given, *[given[-1]] * (KNOTS - len(given))]
            buffer.copy_(torch.tensor(padded))

    def forward(self, force: Tensor) -> Tensor:
        """Return the factors (N,) under nodal forces (N, n_nodes, d)."""
        count = (force != 0).any(dim=2).sum(dim=1)
        first, last = self.counts[:-1], self.counts[1:]
        part = ((count[:, None] - first) / (last - first).clamp(min=1)).clamp(0, 1)
        return self.values[0] + (part * (self.values[1:] - self.values[:-1])).sum(dim=1)
