"""Deep ensembles (Lakshminarayanan et al. 2017): networks that differ by their initial weights.

All members see the same batches, and the loss is the mean of their losses, so that each is trained
as if it were alone. The standard deviation over the members is taken as the epistemic uncertainty.
"""

from __future__ import annotations

from collections.abc import Iterable

import torch
from torch import Tensor, nn


class Ensemble(nn.Module):
    """K networks side by side; their outputs are joined to a batch K times as long.

    Parameters
    ----------
    members : iterable of nn.Module
        Networks with the same inputs and outputs.
    """

    def __init__(self, members: Iterable[nn.Module]) -> None:
        super().__init__()
        self.members = nn.ModuleList(members)

    def forward(self, x: Tensor) -> Tensor:
        """Evaluate one member after the other: (N, …) → (K·N, …)."""
        return torch.cat([member(x) for member in self.members])


def members_of(network: nn.Module) -> int:
    """Return the number of members of the ensemble in a network; 1 if there is none."""
    ensembles = (module for module in network.modules() if isinstance(module, Ensemble))
    return next((len(ensemble.members) for ensemble in ensembles), 1)
