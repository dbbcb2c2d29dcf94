"""A structured dataset, as tensors in memory; the training samples may stay on disk."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from shared_schema.common.errors import InputError
from shared_schema.common.memory import require_memory
from shared_schema.dataset_reader import DatasetReader
from shared_schema.grid import Grid
from shared_schema.layout import Arrays
from shared_schema.manifest import Manifest, StructuredInfo
from shared_schema.material import Materials, materials_of
from shared_schema.stiffness import Stiffness, read_stiffness
from surrogate.data.body_check import Body
from surrogate.data.elements_of_case import with_elements
from surrogate.data.geometry import Geometry
from surrogate.data.nodal_dataset import NodalSamples
from surrogate.data.samples import Samples
from surrogate.data.samples_on_disk import AT_NODES, FIELDS, SamplesOnDisk, nodal_samples


@dataclass(frozen=True)
class Dataset:
    """A structured dataset.

    Attributes
    ----------
    manifest : Manifest
    geometry : Geometry
    train_in_memory : Samples or None
        Training split, in ascending order of the samples' numbers; None if it stays on disk.
    train_on_disk : SamplesOnDisk
        Training split in its files, in the same order.
    test : Samples
        Test split, in the same order.
    nodal_test : NodalSamples
        The test split by nodes.
    stiffness : Stiffness or None
        Stiffness of the undeformed body without supports, if the dataset has it.
    further_on_disk : tuple of SamplesOnDisk
        Training splits of datasets that are joined to it; `train_in_memory` has them as well.
    """

    manifest: Manifest
    geometry: Geometry
    train_in_memory: Samples | None
    train_on_disk: SamplesOnDisk
    test: Samples
    nodal_test: NodalSamples
    stiffness: Stiffness | None = None
    further_on_disk: tuple[SamplesOnDisk, ...] = ()

    @property
    def folder(self) -> Path:
        """Folder of the dataset; of joined ones, that of the first."""
        return self.train_on_disk.reader.folder

    @property
    def train(self) -> Samples:
        """Training split in memory; the dataset must be read with it."""
        assert self.train_in_memory is not None
        return self.train_in_memory

    @property
    def training(self) -> Samples | SamplesOnDisk:
        """Training split, in memory or on disk."""
        return self.train_on_disk if self.train_in_memory is None else self.train_in_memory

    def nodal_train(self, rows: Tensor) -> NodalSamples:
        """Samples of the training split by nodes, given their rows, those of a part together."""
        if self.geometry.grid.points_are_nodes:
            return at_nodes(self.geometry.grid, self.training[rows])
        parts, start = [], 0
        for stored in (self.train_on_disk, *self.further_on_disk):
            own = rows[(rows >= start) & (rows < start + len(stored))] - start
            parts.append(stored.at_nodes(own))
            start += len(stored)
        return NodalSamples(
            np.concatenate([part.force for part in parts]),
            np.concatenate([part.displacement for part in parts]),
        )

    def at_nodes(self) -> Dataset:
        """The dataset on a grid whose points are nodes, for what needs no samples on the grid."""
        geometry = self.geometry
        if geometry.grid.points_are_nodes:
            return self
        row = Grid.in_a_row(*geometry.coordinates.shape)
        return replace(self, geometry=replace(geometry, grid=row))

    @property
    def body(self) -> Body:
        """Mesh, supports and material, to compare with those of a run."""
        return Body(self.manifest.case, self.geometry.arrays())

    @property
    def material(self) -> Materials:
        """Material of the body, or those of its parts; InputError if they are not shipped ones."""
        return materials_of(self.manifest.case.get("material"), "material of the dataset's case")

    @property
    def info(self) -> StructuredInfo:
        """Grid, split and statistics from the manifest."""
        assert self.manifest.structured is not None
        return self.manifest.structured


def read_single(folder: Path, *, on_disk: bool = False, needs_samples: bool = True) -> Dataset:
    """Read one structured dataset (see `surrogate.read_dataset`).

    At most one shard is in memory besides the result.
    """
    reader = DatasetReader(folder, "structured")
    manifest = reader.manifest
    if manifest.samples == 0 and needs_samples:
        raise InputError(
            f"{folder}: a body without samples; expected some, made by `datagen run` and `datagen "
            "structure` (only 'model: series' needs none)"
        )
    geometry = with_elements(Geometry.from_arrays(reader.body, reader.cell_type), manifest.case)
    is_exact = geometry.grid.points_are_nodes
    everything = reader.ascending()
    is_test = np.empty(len(everything), dtype=np.bool_)
    for shard, column in enumerate(reader.columns("samples/is_test")):
        place = everything.places(shard)
        is_test[place] = column[everything.row[place]]
    training, testing = everything[~is_test], everything[is_test]
    sample = 2 * 4 * geometry.dimension * geometry.grid.mask.size
    kept = len(testing) if on_disk else len(everything)
    hint = "" if on_disk else " (with 'training.samples_on' = 'disk', only those of the test split)"
    require_memory(kept * sample, f"{folder}: {kept} samples in memory{hint}")
    train: Samples | None = None
    if is_exact and not on_disk:
        trained, tested = reader.gathered(FIELDS, training, testing)  # every shard is read once
        train = samples_of(trained)
    else:
        if not on_disk:
            (trained,) = reader.gathered(FIELDS, training)
            train = samples_of(trained)
        (tested,) = reader.gathered(FIELDS if is_exact else (*FIELDS, *AT_NODES), testing)
    test = samples_of(tested)
    if is_exact:
        nodal_test = at_nodes(geometry.grid, test)
    else:
        nodal_test = nodal_samples(tested, len(geometry.coordinates))
    has_stiffness = manifest.stiffness_checksum is not None
    stiffness = read_stiffness(folder) if has_stiffness else None
    stored = SamplesOnDisk(reader, training)
    return Dataset(manifest, geometry, train, stored, test, nodal_test, stiffness)


def samples_of(arrays: Arrays) -> Samples:
    """Samples as tensors, which share their memory with the arrays."""
    force, displacement = FIELDS
    return Samples(torch.from_numpy(arrays[force]), torch.from_numpy(arrays[displacement]))


def at_nodes(grid: Grid, samples: Samples) -> NodalSamples:
    """Take samples from an exact grid to the nodes."""
    force = grid.to_nodes(samples.force.numpy()).astype(np.float64)
    displacement = grid.to_nodes(samples.displacement.numpy()).astype(np.float64)
    return NodalSamples(force, displacement)
