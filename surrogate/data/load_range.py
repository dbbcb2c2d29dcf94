"""What the load cases of a training had in common: numbers of loaded nodes, and resultants."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import torch
from torch import Tensor

from shared_schema.common.configuration import Frozen

if TYPE_CHECKING:
    from surrogate.data.dataset import Dataset

AT_ONCE = 2**20  # grid points of all samples that are held at once


class LoadRange(Frozen):
    """Ranges over the training split.

    Attributes
    ----------
    fewest, most : int
        Smallest and largest number of loaded nodes of a sample.
    resultant : tuple of d floats
        Largest absolute component of the sum of a sample's forces, in N.
    """

    fewest: int
    most: int
    resultant: tuple[float, ...]


def load_range(dataset: Dataset) -> LoadRange:
    """Measure the training split of a dataset."""
    parts = [_measured(forces) for forces in _nodal_forces(dataset)]
    count = torch.cat([part[0] for part in parts])
    resultant = torch.cat([part[1] for part in parts])
    return LoadRange(
        fewest=int(count.min()),
        most=int(count.max()),
        resultant=tuple(resultant.abs().amax(dim=0).tolist()),
    )


def _nodal_forces(dataset: Dataset) -> Iterator[Tensor]:
    """Yield the forces of the training split, (n, d, n_nodes) each."""
    samples = max(1, AT_ONCE // dataset.geometry.grid.mask.size)
    for rows in torch.split(torch.arange(len(dataset.training)), samples):
        if dataset.geometry.grid.points_are_nodes:
            yield dataset.training[rows].force.flatten(2)
        else:
            yield torch.from_numpy(dataset.nodal_train(rows).force).transpose(1, 2)


def _measured(forces: Tensor) -> tuple[Tensor, Tensor]:
    """Numbers of loaded nodes, and resultants: (N, d, n_nodes) → (N,), (N, d)."""
    return (forces != 0).any(dim=1).sum(dim=1), forces.double().sum(dim=2)
