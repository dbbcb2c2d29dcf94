"""Samples on the grid, in memory."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import torch
from torch import Tensor

Location = Literal["auto", "device", "host", "disk"]  # memory of the samples during a training


@dataclass(frozen=True)
class Samples:
    """Forces and the displacements that they cause, on the grid.

    Attributes
    ----------
    force : Tensor, (N, d, nx, ny[, nz])
        In N.
    displacement : Tensor, (N, d, nx, ny[, nz])
        In m.
    """

    force: Tensor
    displacement: Tensor

    def __len__(self) -> int:
        return len(self.force)

    def __getitem__(self, index: Tensor | slice) -> Samples:
        return Samples(self.force[index], self.displacement[index])

    def subset(self, rows: Tensor) -> Samples:
        """Some of the samples, given their ascending rows; all of them are not copied."""
        return self if len(rows) == len(self) else self[rows]

    def in_memory(self) -> Samples:
        """The samples themselves."""
        return self

    def order(self, generator: torch.Generator) -> Tensor:
        """Random order of the samples for a training."""
        return torch.randperm(len(self), generator=generator)

    def to(self, device: torch.device) -> Samples:
        """The same samples on a device."""
        return Samples(self.force.to(device), self.displacement.to(device))
