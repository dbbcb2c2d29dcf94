"""Deep ensembles (Lakshminarayanan et al. 2017): networks that differ by their initial weights.

All members see the same batches, and the loss is the mean of theirs, so that each is trained as if
it were alone. Their spread is taken for the epistemic uncertainty.
"""

from __future__ import annotations

from collections.abc import Iterable

import torch
from torch import Tensor, nn


class Ensemble(nn.Module):
    """K networks side by side: the batch becomes K times as long, one member's after the other's.

    Parameters
    ----------
    members : iterable of nn.Module
        Of the same inputs and outputs.
    """

    def __init__(self, members: Iterable[nn.Module]) -> None:
        super().__init__()
        self.members = nn.ModuleList(members)

    def forward(self, x: Tensor) -> Tensor:
        """Let every member do it: (N, …) → (K·N, …)."""
        return torch.cat([member(x) for member in self.members])
