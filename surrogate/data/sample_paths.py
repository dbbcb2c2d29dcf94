r"""Load paths of samples: each sample is a family of solutions around its load.

.. math:: F + t ΔF \mapsto U + t U_1 + t^2 U_2, \qquad t \in [-1, 1]

A training draws one path and one t whenever it takes a sample (`surrogate.mechanics.load_path`).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import torch
from torch import Tensor

from surrogate.data.geometry import Geometry
from surrogate.data.mirror import fields_with_mirror_images
from surrogate.data.sample_store import SampleStore
from surrogate.data.samples import Samples


@dataclass(frozen=True)
class SamplePaths:
    """K load paths of each of N samples, on the grid.

    Attributes
    ----------
    force : Tensor, (N, K, d, nx, ny[, nz])
        ΔF in N; as `FieldNetwork.prepared` returns it, the change of the network's input.
    first, second : Tensor, (N, K, d, nx, ny[, nz])
        U₁ and U₂ in m.
    """

    force: Tensor
    first: Tensor
    second: Tensor

    def __len__(self) -> int:
        return len(self.force)

    def with_mirror_images(
        self, geometry: Geometry, axes: tuple[str, ...], key: str
    ) -> SamplePaths:
        """Add the paths of the mirror images of the samples (`surrogate.data.mirror`)."""
        shape = (-1, *self.force.shape[1:])
        fields = [field.flatten(0, 1) for field in (self.force, self.first, self.second)]
        both = fields_with_mirror_images(fields, geometry, axes, key)
        return SamplePaths(*(field.reshape(shape) for field in both))


class AlongPaths:
    """A store whose batches are drawn from the load paths of its samples.

    Parameters
    ----------
    store : SampleStore
        The samples themselves.
    paths : SamplePaths
        Their paths, in the same order.
    """

    def __init__(self, store: SampleStore, paths: SamplePaths) -> None:
        self.home, self._store = store.home, store
        fields = (paths.force, paths.first, paths.second)
        self._paths = SamplePaths(*(field.to(self.home) for field in fields))

    def batches(self, indices: Iterable[Tensor]) -> Iterator[Samples]:
        """Yield batches, each sample at a random point of a random path."""
        kept = list(indices)
        for rows, samples in zip(kept, self._store.batches(kept), strict=True):
            yield self._moved(rows, samples)

    def _moved(self, rows: Tensor, samples: Samples) -> Samples:
        count, ones = self._paths.force.shape[1], (1,) * (samples.force.ndim - 1)
        path = torch.randint(count, (len(rows),)).to(self.home)
        t = 2 * torch.rand(len(rows)).reshape(-1, *ones).to(samples.force.device) - 1
        force, first, second = (
            field[rows, path].to(samples.force.device)
            for field in (self._paths.force, self._paths.first, self._paths.second)
        )
        return Samples(samples.force + t * force, samples.displacement + t * (first + t * second))
