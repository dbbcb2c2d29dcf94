r"""Samples of a structured dataset that are read from its shards whenever they are used.

A training draws them in an order that needs only few shards at a time. With a random order of the
shards, p(s) the position of shard s in it, and a window of W shards, sample i of shard s(i) has
the key

.. math:: k_i = p(s(i)) + W u_i, \qquad u_i \sim U(0, 1),

and the samples are taken in the order of their keys. So one shard after another comes into memory,
stays for W shards, and gives its samples at random within this window.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from functools import cached_property
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from shared_schema.common.bodies.nodal_forces import scatter_forces
from shared_schema.common.errors import InputError
from shared_schema.dataset_reader import DatasetReader, Selection
from shared_schema.layout import Arrays
from shared_schema.shard import read_arrays
from surrogate.learning.data.samples import BETWEEN, PARAMETERS, NodalSamples, Samples, further_in

FIELDS = ("samples/force", "samples/displacement")
AT_NODES = ("samples/loaded_nodes", "samples/nodal_force", "samples/nodal_displacement")
WINDOW = 1 << 28  # bytes of samples among which the order is random
AHEAD = 4  # shards that are read before they are needed

Written = tuple[int, int]
Shard = tuple[Tensor, Tensor]  # its forces and displacements


class SamplesOnDisk:
    """Some samples of a dataset, in ascending order of their number.

    Parameters
    ----------
    reader : DatasetReader
    selection : Selection
    written : list of tuple, optional
        State of every shard (`written`) when its checksum was found right; now by default.
    """

    def __init__(
        self, reader: DatasetReader, selection: Selection, written: list[Written] | None = None
    ) -> None:
        self.reader, self.selection = reader, selection
        self._paths = [reader.folder / entry.file for entry in reader.manifest.shards]
        self._written = written or [last_written(path) for path in self._paths]

    def __len__(self) -> int:
        return len(self.selection)

    def __getitem__(self, rows: Tensor | slice) -> Samples:
        """Read some samples into memory."""
        chosen = self.selection[rows if isinstance(rows, slice) else rows.numpy()]
        (arrays,) = self.reader.gathered(FIELDS, chosen)
        force, displacement = FIELDS
        return Samples(torch.from_numpy(arrays[force]), torch.from_numpy(arrays[displacement]))

    def subset(self, rows: Tensor) -> SamplesOnDisk:
        """Some of the samples; nothing is read."""
        return SamplesOnDisk(self.reader, self.selection[rows.numpy()], self._written)

    def at_nodes(self, rows: Tensor) -> NodalSamples:
        """Read some samples of an embedded grid by nodes."""
        names = (*AT_NODES, *further_in(self.reader))
        (arrays,) = self.reader.gathered(names, self.selection[rows.numpy()])
        return nodal_samples(arrays, len(self.reader.body["mesh/coordinates"]))

    def between(self, rows: Tensor) -> NDArray[np.float64] | None:
        """Read the forces between the nodes of some samples; None if the dataset has none."""
        if BETWEEN not in further_in(self.reader):
            return None
        (arrays,) = self.reader.gathered((BETWEEN,), self.selection[rows.numpy()])
        return arrays[BETWEEN]

    @cached_property
    def window(self) -> int:
        """Number W of shards of the window; it depends on the dataset only."""
        manifest = self.reader.manifest
        assert manifest.structured is not None
        largest = max(entry.samples for entry in manifest.shards)
        values = manifest.dimension * int(np.prod(manifest.structured.grid_shape))
        return max(1, WINDOW // (2 * 4 * values * max(largest, 1)))

    def in_memory(self) -> Samples:
        """Read all samples."""
        return self[:]

    def order(self, generator: torch.Generator) -> Tensor:
        """Random order of the samples for a training, see the top of the file."""
        shards, of_sample = np.unique(self.selection.shard, return_inverse=True)
        position = torch.randperm(len(shards), generator=generator)
        spread = torch.rand(len(self), generator=generator, dtype=torch.float64)
        keys = position[torch.from_numpy(of_sample)] + self.window * spread
        return torch.argsort(keys, stable=True)

    def some(self, generator: torch.Generator) -> Samples:
        """Read the samples of as many random shards as a window holds."""
        shards = np.unique(self.selection.shard)
        chosen = torch.randperm(len(shards), generator=generator)[: self.window].numpy()
        rows = np.flatnonzero(np.isin(self.selection.shard, shards[chosen]))
        return self[torch.from_numpy(rows)]

    def batches(self, indices: Iterable[Tensor], pinned: bool) -> Iterator[Samples]:
        """Yield some batches, given the numbers of their samples; shards are read ahead.

        Every shard is read when the first batch needs it, and dropped after the last one.
        """
        batches = list(indices)
        uses = [np.unique(self.selection.shard[batch.numpy()]).tolist() for batch in batches]
        last = {shard: number for number, used in enumerate(uses) for shard in used}
        upcoming = iter(dict.fromkeys(shard for used in uses for shard in used))
        loading: deque[tuple[int, Future[Shard]]] = deque()
        held: dict[int, Shard] = {}
        with ThreadPoolExecutor(1) as reading:

            def read_ahead() -> None:
                while len(loading) < AHEAD and (shard := next(upcoming, None)) is not None:
                    loading.append((shard, reading.submit(self._shard, shard)))

            for number, (batch, used) in enumerate(zip(batches, uses, strict=True)):
                read_ahead()
                while any(shard not in held for shard in used):
                    shard, future = loading.popleft()
                    held[shard] = future.result()
                    read_ahead()
                yield self._batch(batch.numpy(), held, pinned)
                for shard in used:
                    if last[shard] == number:
                        del held[shard]

    def _shard(self, number: int) -> Shard:
        """Read a shard again, which must be as it was when its checksum was found right."""
        path = self._paths[number]
        if last_written(path) != self._written[number]:
            raise InputError(f"{path}: changed during the training")
        arrays = read_arrays(path, "structured", FIELDS)
        force, displacement = FIELDS
        return torch.from_numpy(arrays[force]), torch.from_numpy(arrays[displacement])

    def _batch(self, batch: NDArray[np.int64], held: dict[int, Shard], pinned: bool) -> Samples:
        """Collect the samples of a batch from the shards in memory."""
        chosen = self.selection[batch]
        manifest = self.reader.manifest
        assert manifest.structured is not None
        shape = (len(batch), manifest.dimension, *manifest.structured.grid_shape)
        fields = [torch.empty(shape, pin_memory=pinned) for _ in FIELDS]
        for shard in np.unique(chosen.shard):
            place = torch.from_numpy(chosen.places(shard))
            row = torch.from_numpy(chosen.row[chosen.places(shard)])
            for field, values in zip(fields, held[shard], strict=True):
                field[place] = values[row]
        return Samples(*fields)


def last_written(path: Path) -> Written:
    """Time in ns and size in bytes with which a file was written."""
    found = path.stat()
    return found.st_mtime_ns, found.st_size


def nodal_samples(arrays: Arrays, nodes: int) -> NodalSamples:
    """Forces and displacements by nodes from the arrays `AT_NODES` of an embedded grid."""
    loaded, loads, displacement = AT_NODES
    force = scatter_forces(arrays[loaded].astype(np.int64), arrays[loads], nodes)
    moved = arrays[displacement].astype(np.float64)
    fields = force.astype(np.float64), moved, arrays.get(BETWEEN)
    return NodalSamples(*fields, parameters=arrays.get(PARAMETERS))
