"""Read a whole dataset: its manifest, its mesh, and the samples of all its shards."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shared_schema.checker import require_intact
from shared_schema.common.arguments import read_only
from shared_schema.common.bodies.cells import conformity_problem
from shared_schema.common.errors import InputError
from shared_schema.layout import Arrays, Kind
from shared_schema.manifest import Manifest, ShardEntry, read_manifest
from shared_schema.shard import read_arrays, read_attributes, read_shard

Numbers = NDArray[np.int64]


@dataclass(frozen=True)
class Selection:
    """Some samples of a dataset, in an order of choice.

    Attributes
    ----------
    group : str
        ``samples`` or ``failed``.
    shard, row : array of int, (N,)
        Number of the shard of each sample in the manifest, and its row there.
    """

    group: str
    shard: Numbers
    row: Numbers

    def __len__(self) -> int:
        return len(self.shard)

    def places(self, shard: int) -> Numbers:
        """Positions in the selection of the samples of one shard."""
        order, starts = self._by_shard
        return order[starts[shard] : starts[shard + 1]] if shard + 1 < len(starts) else order[:0]

    @cached_property
    def _by_shard(self) -> tuple[Numbers, Numbers]:
        """Positions sorted by shard, and the start of every shard in them."""
        order = np.argsort(self.shard, kind="stable")
        count = int(self.shard.max(initial=-1)) + 2
        return order, np.searchsorted(self.shard[order], np.arange(count))

    def __getitem__(self, index: NDArray[np.bool_] | Numbers | slice) -> Selection:
        return Selection(self.group, self.shard[index], self.row[index])


def unstable_samples(numbers: Numbers) -> str:
    """Say how many samples are unstable, and their numbers, the first ten of them."""
    if not len(numbers):
        return "no unstable samples"
    some = ", ".join(str(number) for number in numbers[:10]) + (", …" if len(numbers) > 10 else "")
    if len(numbers) == 1:
        return f"1 unstable sample, number {some}"
    return f"{len(numbers)} unstable samples, numbers {some}"


class DatasetReader:
    """A dataset whose files all have the checksums of its manifest.

    Parameters
    ----------
    folder : Path
    kind : {"nodal", "structured"}, optional
        Kind that the caller needs.

    Attributes
    ----------
    folder : Path
    manifest : Manifest

    Raises
    ------
    InputError
        If there is no dataset, it is of another kind, or a file is missing or damaged.
    """

    def __init__(self, folder: Path, kind: Kind | None = None) -> None:
        self.folder = folder
        self.manifest: Manifest = read_manifest(folder, kind)
        require_intact(folder, self.manifest)

    def shard(self, entry: ShardEntry) -> Arrays:
        """Read every array of one shard."""
        lengths = entry.lengths(self.manifest)
        return read_shard(self.folder / entry.file, self.manifest.kind, lengths)

    def __iter__(self) -> Iterator[tuple[ShardEntry, Arrays]]:
        """Read the shards in turn, one at a time in memory."""
        return ((entry, self.shard(entry)) for entry in self.manifest.shards)

    @cached_property
    def cell_type(self) -> str:
        """Meshio's name of the cells."""
        path = self.folder / self.manifest.shards[0].file
        return str(read_attributes(path, self.manifest.kind)["cell_type"])

    @property
    def body(self) -> Arrays:
        """The arrays that every shard repeats: those below ``mesh/`` and ``grid/``; read-only.

        Raises
        ------
        InputError
            If the cells have a `conformity_problem`.
        """
        return dict(self._body)

    @cached_property
    def _body(self) -> Arrays:
        """The arrays of `body`, which is a new mapping each time."""
        entry = self.manifest.shards[0]
        arrays = {
            name: read_only(values)
            for name, values in self.shard(entry).items()
            if name.startswith(("mesh/", "grid/"))
        }
        mesh = arrays["mesh/coordinates"], arrays["mesh/cells"]
        problem = conformity_problem(*mesh, self.cell_type)
        if problem is not None:
            raise InputError(f"{self.folder / entry.file}: dataset 'mesh/cells': {problem}")
        return arrays

    def joined(self, names: Collection[str]) -> Arrays:
        """Read arrays of all shards, samples in ascending order of their number.

        Parameters
        ----------
        names : collection of str
            Paths of arrays below ``samples/`` or ``failed/``; each shard is read once for all.
        """
        groups = sorted({name.partition("/")[0] for name in names})
        found = self.gathered(names, *(self.ascending(group) for group in groups))
        joined = {name: values for arrays in found for name, values in arrays.items()}
        return {name: joined[name] for name in names}

    def ascending(self, group: str = "samples") -> Selection:
        """Select all samples of a group, in ascending order of their number."""
        numbers = self.columns(f"{group}/number")
        shard = np.repeat(np.arange(len(numbers)), [len(column) for column in numbers])
        row = np.concatenate([np.arange(len(column)) for column in numbers])
        order = np.argsort(np.concatenate(numbers))
        return Selection(group, shard[order], row[order])

    def columns(self, name: str) -> list[NDArray[Any]]:
        """Read one array of every shard; values are not checked."""
        return [
            read_arrays(
                self.folder / entry.file,
                self.manifest.kind,
                (name,),
                entry.lengths(self.manifest),
            )[name]
            for entry in self.manifest.shards
        ]

    def has(self, name: str) -> bool:
        """Whether the first shard, and so every one, has an array that a shard may lack."""
        path = self.folder / self.manifest.shards[0].file
        return name in read_arrays(path, self.manifest.kind, (name,))

    def require_equilibria(self) -> None:
        """Raise InputError if the samples are motions."""
        if self.manifest.case.get("time") is not None:
            raise InputError(f"{self.folder}: the samples are motions, expected equilibria")

    def unstable(self) -> Numbers | None:
        """Numbers of the unstable samples, ascending; None if no shard says which are stable."""
        numbers, known = [], False
        for entry in self.manifest.shards:
            names = ("samples/number", "samples/stable")
            arrays = read_arrays(self.folder / entry.file, self.manifest.kind, names)
            if "samples/stable" in arrays:
                known = True
                numbers.append(arrays["samples/number"][~arrays["samples/stable"]])
        return np.sort(np.concatenate(numbers)) if known else None

    def gathered(self, names: Collection[str], *selections: Selection) -> list[Arrays]:
        """Read arrays of some samples; only one shard is in memory besides the result.

        Parameters
        ----------
        names : collection of str
            Paths of arrays below ``samples/`` or ``failed/``.
        selections : Selection
            Every shard in them is read once for all.

        Returns
        -------
        list of dict
            Arrays of every selection by name, those of its group only.
        """
        gathered: list[Arrays] = [{} for _ in selections]
        needed = np.unique(np.concatenate([selection.shard for selection in selections]))
        if len(needed) == 0:  # no samples; the first shard tells shapes and types
            needed = np.zeros(1, dtype=np.int64)
        for number in needed:
            arrays = self.shard(self.manifest.shards[number])
            for selection, result in zip(selections, gathered, strict=True):
                place = selection.places(number)
                for name in names:
                    if name.startswith(f"{selection.group}/"):
                        values = arrays[name]
                        if name not in result:
                            shape = (len(selection), *values.shape[1:])
                            result[name] = np.empty(shape, dtype=values.dtype)
                        result[name][place] = values[selection.row[place]]
        return gathered
