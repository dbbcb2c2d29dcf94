"""A structured dataset in memory, as tensors."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from shared_schema.checker import require_intact
from shared_schema.errors import InputError
from shared_schema.grid_map import GridMap
from shared_schema.manifest import Manifest, StructuredInfo, read_manifest
from shared_schema.shard import read_attributes, read_shard
from shared_schema.stiffness import Stiffness, read_stiffness
from surrogate.geometry import Geometry
from surrogate.nodal_dataset import NodalSamples, scatter


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
    stiffness : Stiffness or None
        Of the undeformed body without supports, if the dataset has it.
    """

    manifest: Manifest
    geometry: Geometry
    train: Samples
    test: Samples
    nodal_test: NodalSamples
    stiffness: Stiffness | None = None

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
        nodes, loads = joined("samples/loaded_nodes"), joined("samples/nodal_force")
        force = scatter(nodes[chosen], loads[chosen], len(geometry.coordinates))
    nodal_test = NodalSamples(force.astype(np.float64), displacement.astype(np.float64))
    dataset = Dataset(manifest, geometry, samples[~is_test], samples[is_test], nodal_test)
    if dataset.info.stiffness is None:
        return dataset
    return replace(dataset, stiffness=read_stiffness(folder))
