"""A structured dataset in memory, as tensors."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from shared_schema.checker import require_intact
from shared_schema.errors import InputError
from shared_schema.grid_map import NO_NODE, GridMap
from shared_schema.manifest import Manifest, StructuredInfo, read_manifest
from shared_schema.shard import read_attributes, read_shard
from surrogate.geometry import Geometry


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

    def to(self, device: torch.device) -> Samples:
        """The same samples on a device."""
        return Samples(self.force.to(device), self.displacement.to(device))


@dataclass(frozen=True)
class NodalSamples:
    """The same by nodes, as the finite elements have them.

    Attributes
    ----------
    force : array, (N, n_nodes, d)
        In N.
    displacement : array, (N, n_nodes, d)
        In m.
    """

    force: NDArray[np.float64]
    displacement: NDArray[np.float64]


@dataclass(frozen=True)
class Dataset:
    """A structured dataset, whole.

    Attributes
    ----------
    manifest : Manifest
    geometry : Geometry
    train, test : Samples
        In ascending order of the sample number.
    nodal_test : NodalSamples
        The test split by nodes.
    """

    manifest: Manifest
    geometry: Geometry
    train: Samples
    test: Samples
    nodal_test: NodalSamples

    @property
    def info(self) -> StructuredInfo:
        """What the manifest says of the grid, the split and the statistics."""
        assert self.manifest.structured is not None
        return self.manifest.structured


def read_dataset(folder: Path) -> Dataset:
    """Read a structured dataset into memory.

    Raises
    ------
    InputError
        If there is none, it is of another kind, or any byte of it has changed.
    """
    manifest = read_manifest(folder, "structured")
    require_intact(folder, manifest)
    if manifest.samples == 0:
        raise InputError(f"{folder}: no samples in it")
    shards = [read_shard(folder / entry.file, "structured") for entry in manifest.shards]
    cell_type = str(read_attributes(folder / manifest.shards[0].file, "structured")["cell_type"])

    def joined(name: str) -> np.ndarray:
        return np.concatenate([shard[name] for shard in shards])

    order = np.argsort(joined("samples/number"))
    is_test = torch.from_numpy(joined("samples/is_test")[order])
    samples = Samples(
        torch.from_numpy(joined("samples/force")[order]),
        torch.from_numpy(joined("samples/displacement")[order]),
    )
    geometry = Geometry.from_shard(shards[0], cell_type)
    if isinstance(geometry.grid, GridMap):
        force, displacement = (
            geometry.grid.to_nodes(values[is_test].numpy())
            for values in (samples.force, samples.displacement)
        )
    else:
        chosen = order[is_test.numpy()]
        displacement = joined("samples/nodal_displacement")[chosen]
        loads = joined("samples/nodal_force")[chosen]
        force = np.zeros_like(displacement)
        sample, load = np.nonzero((nodes := joined("samples/loaded_nodes")[chosen]) != NO_NODE)
        force[sample, nodes[sample, load]] = loads[sample, load]
    nodal_test = NodalSamples(force.astype(np.float64), displacement.astype(np.float64))
    return Dataset(manifest, geometry, samples[~is_test], samples[is_test], nodal_test)
