"""Place of the samples during a training: the device's memory, the host's, or the disk.

A batch on the device is a gather. Any other batch is copied through pinned memory on a separate
stream while the device works on the batch before. Batches are as the network learns from them
(`FieldNetwork.prepared`).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator
from typing import Protocol

import torch
from torch import Tensor

from shared_schema.common.progress import Progress
from surrogate.learning.data.samples import Location, Samples
from surrogate.learning.data.samples_on_disk import SamplesOnDisk
from surrogate.learning.networks.field_network import FieldNetwork

PART_OF_FREE_MEMORY = 0.5  # what samples may take of the device's; the rest is the network's


class SampleStore(Protocol):
    """Source of batches of samples.

    Attributes
    ----------
    home : torch.device
        Device of the samples, and of the indices of a batch.
    """

    home: torch.device

    def batches(self, indices: Iterable[Tensor]) -> Iterator[Samples]:
        """Yield the samples of some batches on the device, given their indices."""


class DeviceStore:
    """Samples on the device."""

    def __init__(self, samples: Samples, device: torch.device) -> None:
        self.home = device
        self._samples = samples.to(device)

    def batches(self, indices: Iterable[Tensor]) -> Iterator[Samples]:
        """Yield batches."""
        return (self._samples[batch] for batch in indices)


class CopyAhead(ABC):
    """Samples elsewhere, copied to the device one batch ahead."""

    def __init__(self, device: torch.device) -> None:
        self.home = torch.device("cpu")
        self._device = device
        self._stream: torch.cuda.Stream | None = None
        if device.type == "cuda":
            self._stream = torch.cuda.Stream(device)  # type: ignore[no-untyped-call]

    @abstractmethod
    def gathered(self, indices: Iterable[Tensor], pinned: bool) -> Iterator[Samples]:
        """Yield batches in the memory of the host, pinned for copies to a GPU."""

    def batches(self, indices: Iterable[Tensor]) -> Iterator[Samples]:
        """Yield batches; the copy of the next one is already started."""
        ahead: tuple[Samples, torch.cuda.Event | None] | None = None
        for batch in self.gathered(indices, pinned=self._stream is not None):
            following = self._send(batch)
            if ahead is not None:
                yield self._receive(*ahead)
            ahead = following
        if ahead is not None:
            yield self._receive(*ahead)

    def _send(self, batch: Samples) -> tuple[Samples, torch.cuda.Event | None]:
        """Begin to copy a batch."""
        if self._stream is None:
            return batch.to(self._device), None
        with torch.cuda.stream(self._stream):
            force = batch.force.to(self._device, non_blocking=True)
            displacement = batch.displacement.to(self._device, non_blocking=True)
            return Samples(force, displacement), self._stream.record_event()

    def _receive(self, samples: Samples, sent: torch.cuda.Event | None) -> Samples:
        """Let the device's current stream wait until a batch is there."""
        if sent is not None:
            current = torch.cuda.current_stream(self._device)
            current.wait_event(sent)
            for field in (samples.force, samples.displacement):
                field.record_stream(current)
        return samples


class HostStore(CopyAhead):
    """Samples in the memory of the host."""

    def __init__(self, samples: Samples, device: torch.device) -> None:
        super().__init__(device)
        self._samples = samples.to(self.home)

    def gathered(self, indices: Iterable[Tensor], pinned: bool) -> Iterator[Samples]:
        """Yield batches."""
        for batch in indices:
            if pinned:
                force = gather_pinned(self._samples.force, batch)
                yield Samples(force, gather_pinned(self._samples.displacement, batch))
            else:
                yield self._samples[batch]


class DiskStore(CopyAhead):
    """Samples on disk."""

    def __init__(self, samples: SamplesOnDisk, device: torch.device) -> None:
        super().__init__(device)
        self._samples = samples

    def gathered(self, indices: Iterable[Tensor], pinned: bool) -> Iterator[Samples]:
        """Yield batches; their shards are read ahead."""
        return self._samples.batches(indices, pinned)


def gather_pinned(field: Tensor, indices: Tensor) -> Tensor:
    """Gather samples into pinned memory, from which the device copies asynchronously."""
    pinned = torch.empty((len(indices), *field.shape[1:]), dtype=field.dtype, pin_memory=True)
    return torch.index_select(field, 0, indices, out=pinned)


def store_samples(
    samples: Samples | SamplesOnDisk, location: Location, device: torch.device
) -> SampleStore:
    """Put samples into the memory of a location; ``auto``: the device's, if they fit.

    Samples on disk stay there.
    """
    if isinstance(samples, SamplesOnDisk):
        return DiskStore(samples, device)
    on_device = location == "device" or (location == "auto" and fits(samples, device))
    return DeviceStore(samples, device) if on_device else HostStore(samples, device)


def fits(samples: Samples, device: torch.device) -> bool:
    """True if samples leave enough of a device's free memory for the training."""
    if device.type != "cuda":
        return True
    free, _ = torch.cuda.mem_get_info(device)
    return samples.force.nbytes + samples.displacement.nbytes <= PART_OF_FREE_MEMORY * free


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
    at_once = network.last_gradient is None and samples.parameters is None
    if at_once or len(samples) == 0:
        return network.prepared(samples)
    title = "load series" if samples.parameters is None else "shapes"
    progress = Progress(len(samples), 0, "loads", f"surrogate train: {title}")
    found = network.prepared(samples, progress.update)
    progress.close("done")
    return found
