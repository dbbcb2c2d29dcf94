"""What the load cases of a training had in common: numbers of loaded nodes, and resultants."""

from __future__ import annotations

import torch
from torch import Tensor

from shared_schema.common.configuration import Frozen
from surrogate.data.dataset import Dataset

AT_ONCE = 1000  # samples


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
    if dataset.embedded_train is None:
        forces = dataset.train.force.flatten(2)
    else:
        forces = torch.from_numpy(dataset.embedded_train.force).transpose(1, 2)
    parts = [_measured(part) for part in torch.split(forces, AT_ONCE)]
    count, resultant = (torch.cat(measured) for measured in zip(*parts, strict=True))
    return LoadRange(
        fewest=int(count.min()),
        most=int(count.max()),
        resultant=tuple(resultant.abs().amax(dim=0).tolist()),
    )


def _measured(forces: Tensor) -> tuple[Tensor, Tensor]:
    """Numbers of loaded nodes, and resultants: (N, d, n_nodes) → (N,), (N, d)."""
    return (forces != 0).any(dim=1).sum(dim=1), forces.double().sum(dim=2)
