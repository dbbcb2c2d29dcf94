"""Samples of a training as its network learns from them (`FieldNetwork.prepared`)."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import torch
from torch import Tensor

from shared_schema.common.progress import Progress
from surrogate.data.sample_paths import SamplePaths
from surrogate.data.sample_store import Location, SampleStore, store_samples
from surrogate.data.samples import Samples
from surrogate.data.samples_on_disk import SamplesOnDisk
from surrogate.networks.field_network import FieldNetwork


class PreparedInBatches:
    """Samples on disk, prepared batch by batch.

    Parameters
    ----------
    store : SampleStore
    network : FieldNetwork
    """

    def __init__(self, store: SampleStore, network: FieldNetwork) -> None:
        self.home, self._store, self._network = store.home, store, network

    def batches(self, indices: Iterable[Tensor]) -> Iterator[Samples]:
        """Yield batches."""
        return (self._network.prepared(batch) for batch in self._store.batches(indices))


def prepared_store(
    samples: Samples | SamplesOnDisk,
    network: FieldNetwork,
    location: Location,
    device: torch.device,
) -> SampleStore:
    """Put samples into the memory of a location, prepared once unless they are on disk."""
    if isinstance(samples, SamplesOnDisk):
        return PreparedInBatches(store_samples(samples, location, device), network)
    return store_samples(_prepared(samples, network), location, device)


def _prepared(samples: Samples, network: FieldNetwork) -> Samples:
    """Prepare samples; with progress, if each takes time for a load series."""
    if network.foretold is None or len(samples) == 0:
        return network.prepared(samples)
    progress = Progress(len(samples), 0, "loads", "surrogate train: load series")
    found = network.prepared(samples, progress.update)
    progress.close("done")
    return found


def prepared_paths(paths: SamplePaths, network: FieldNetwork) -> SamplePaths:
    """Prepare load paths as their samples: what a network is given is linear in the forces."""
    found = network.prepared(Samples(paths.force.flatten(0, 1), paths.first.flatten(0, 1)))
    change = found.force.reshape(*paths.force.shape[:2], *found.force.shape[1:])
    return SamplePaths(change, found.displacement.reshape(paths.first.shape), paths.second)
