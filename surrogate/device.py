"""The device that tensors live on."""

from __future__ import annotations

import torch

from shared_schema.errors import InputError


def choose_device(name: str) -> torch.device:
    """The device of a name: ``auto`` is cuda where there is one, else cpu."""
    if name == "auto":
        return torch.device("cuda" if torch.cuda.is_available() else "cpu")
    if name == "cuda" and not torch.cuda.is_available():
        raise InputError("--device 'cuda': none here, expected 'cpu' or 'auto'")
    return torch.device(name)
