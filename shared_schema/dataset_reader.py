"""Read a whole dataset: its manifest, its mesh, and the samples of all its shards."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from functools import cached_property
from pathlib import Path

import numpy as np

from shared_schema.checker import require_intact
from shared_schema.layout import Arrays, Kind
from shared_schema.manifest import Manifest, ShardEntry, read_manifest
from shared_schema.shard_reader import read_attributes, read_shard


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
        return read_shard(self.folder / entry.file, self.manifest.kind)

    def __iter__(self) -> Iterator[tuple[ShardEntry, Arrays]]:
        """Read the shards in turn, one at a time in memory."""
        return ((entry, self.shard(entry)) for entry in self.manifest.shards)

    @cached_property
    def cell_type(self) -> str:
        """Meshio's name of the cells."""
        path = self.folder / self.manifest.shards[0].file
        return str(read_attributes(path, self.manifest.kind)["cell_type"])

    @cached_property
    def body(self) -> Arrays:
        """The arrays that every shard repeats: those below ``mesh/`` and ``grid/``."""
        return {
            name: values
            for name, values in self.shard(self.manifest.shards[0]).items()
            if name.startswith(("mesh/", "grid/"))
        }

    def joined(self, names: Collection[str]) -> Arrays:
        """Read arrays of all shards, samples in ascending order of their number.

        Parameters
        ----------
        names : collection of str
            Paths of arrays below ``samples/`` or ``failed/``; each shard is read once for all.
        """
        groups = {name.partition("/")[0] for name in names}
        numbers = {f"{group}/number" for group in groups}
        pieces: dict[str, list[np.ndarray]] = {name: [] for name in {*names, *numbers}}
        for _, arrays in self:
            for name, found in pieces.items():
                found.append(arrays[name])
        order = {group: np.argsort(np.concatenate(pieces[f"{group}/number"])) for group in groups}
        return {
            name: np.concatenate(pieces.pop(name))[order[name.partition("/")[0]]] for name in names
        }
