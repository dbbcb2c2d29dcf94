"""Samples by nodes, as the finite elements have them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from shared_schema.checker import require_intact
from shared_schema.common.errors import InputError
from shared_schema.common.nodal_forces import scatter_forces
from shared_schema.manifest import Manifest, read_manifest
from shared_schema.shard_reader import read_shard

Array = NDArray[np.float64]


@dataclass(frozen=True)
class NodalSamples:
    """Forces and the displacements that they cause.

    Attributes
    ----------
    force : array, (N, n_nodes, d)
        In N.
    displacement : array, (N, n_nodes, d)
        In m.
    """

    force: Array
    displacement: Array


@dataclass(frozen=True)
class NodalDataset:
    """A nodal dataset, whole.

    Attributes
    ----------
    manifest : Manifest
    coordinates : array, (n_nodes, d)
        In m.
    samples : NodalSamples
        In ascending order of the sample number.
    """

    manifest: Manifest
    coordinates: Array
    samples: NodalSamples


def read_nodal_dataset(folder: Path) -> NodalDataset:
    """Read the solved samples of a nodal dataset.

    Raises
    ------
    InputError
        If there is none, it is of another kind, or any byte of it has changed.
    """
    manifest = read_manifest(folder, "nodal")
    require_intact(folder, manifest)
    if manifest.samples == 0:
        raise InputError(f"{folder}: no samples in it")
    shards = [read_shard(folder / entry.file, "nodal") for entry in manifest.shards]
    coordinates = shards[0]["mesh/coordinates"]
    order = np.argsort(np.concatenate([shard["samples/number"] for shard in shards]))

    def joined(name: str) -> NDArray[np.float64]:
        return np.concatenate([shard[name] for shard in shards])[order]

    nodes = joined("samples/loaded_nodes").astype(np.int64)
    force = scatter_forces(nodes, joined("samples/force"), len(coordinates))
    samples = NodalSamples(force, joined("samples/displacement"))
    return NodalDataset(manifest, coordinates, samples)
