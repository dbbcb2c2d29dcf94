"""Modules that are fitted to the data directly, not trained step by step."""

from __future__ import annotations

from typing import Any

import torch
from torch import nn


class Fitted(nn.Module):
    """A module whose tensors come from a fit, which also determines their shapes.

    Parameters
    ----------
    names : str
        Names of the tensors; they are empty until they are fitted or loaded.
    """

    def __init__(self, *names: str) -> None:
        super().__init__()
        self._names = names
        for name in names:
            self.register_buffer(name, torch.empty(0))

    def _load_from_state_dict(self, state: dict[str, Any], prefix: str, *others: Any) -> None:
        for name in self._names:
            if prefix + name in state:
                setattr(self, name, torch.empty_like(state[prefix + name]))
        super()._load_from_state_dict(state, prefix, *others)
