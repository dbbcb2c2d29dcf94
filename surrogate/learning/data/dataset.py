"""A structured dataset, as tensors in memory; the training samples may stay on disk."""

from __future__ import annotations

import logging
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from shared_schema.common.errors import InputError
from shared_schema.common.machine import require_memory
from shared_schema.dataset_reader import DatasetReader
from shared_schema.grid import Grid
from shared_schema.layout import Arrays
from shared_schema.manifest import Manifest, StructuredInfo
from shared_schema.materials import Materials, materials_of
from shared_schema.stiffness import Stiffness, read_stiffness
from surrogate.learning.data.body_check import BodyRecord
from surrogate.learning.data.samples import BETWEEN, PARAMETERS, NodalSamples, Samples, further_in
from surrogate.learning.data.samples_on_disk import AT_NODES, FIELDS, SamplesOnDisk, nodal_samples
from surrogate.mechanics.body.elements_of_case import loads_of_before, with_elements
from surrogate.mechanics.body.geometry import Geometry

logger = logging.getLogger(__name__)


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
            between = [(len(own), part.between(own)) for part, own in self._parts(rows)]
            return at_nodes(self.geometry.grid, self.training[rows], joined_between(between))
        parts = [part.at_nodes(own) for part, own in self._parts(rows)]
        return NodalSamples(
            np.concatenate([part.force for part in parts]),
            np.concatenate([part.displacement for part in parts]),
            joined_between([(len(part.force), part.force_between) for part in parts]),
            parameters=joined_parameters([part.parameters for part in parts]),
        )

    def _parts(self, rows: Tensor) -> Iterator[tuple[SamplesOnDisk, Tensor]]:
        """Files of the training split, and which of some rows of it are theirs."""
        start = 0
        for stored in (self.train_on_disk, *self.further_on_disk):
            yield stored, rows[(rows >= start) & (rows < start + len(stored))] - start
            start += len(stored)

    def at_nodes(self) -> Dataset:
        """The dataset on a grid whose points are nodes, for what needs no samples on the grid."""
        geometry = self.geometry
        if geometry.grid.points_are_nodes:
            return self
        row = Grid.in_a_row(*geometry.coordinates.shape)
        return replace(self, geometry=replace(geometry, grid=row))

    @property
    def body(self) -> BodyRecord:
        """Mesh, supports and material, to compare with those of a run."""
        return BodyRecord(self.manifest.case, self.geometry.arrays())

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
    geometry = Geometry.from_arrays(reader.body, reader.cell_type)
    geometry = with_elements(geometry, manifest.case, manifest.forces)
    if (of_before := loads_of_before(geometry)) is not None:
        logger.warning("%s: %s", folder, of_before)
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
    further = further_in(reader)
    fields = (*FIELDS, *further[-1:]) if geometry.shapes is not None else FIELDS
    if is_exact and not on_disk and BETWEEN not in further:
        trained, tested = reader.gathered(fields, training, testing)  # every shard is read once
        train = samples_of(trained)
    else:
        if not on_disk:
            (trained,) = reader.gathered(fields, training)
            train = samples_of(trained)
        at = () if is_exact else AT_NODES
        (tested,) = reader.gathered((*FIELDS, *at, *further), testing)
    test = samples_of(tested)
    if is_exact:
        nodal_test = at_nodes(geometry.grid, test, tested.get(BETWEEN))
    else:
        nodal_test = nodal_samples(tested, len(geometry.coordinates))
    has_stiffness = manifest.stiffness_checksum is not None
    stiffness = read_stiffness(folder) if has_stiffness else None
    stored = SamplesOnDisk(reader, training)
    return Dataset(manifest, geometry, train, stored, test, nodal_test, stiffness)


def samples_of(arrays: Arrays) -> Samples:
    """Samples as tensors, which share their memory with the arrays."""
    force, displacement = FIELDS
    fields = torch.from_numpy(arrays[force]), torch.from_numpy(arrays[displacement])
    return Samples(*fields, parameters=arrays.get(PARAMETERS))


def at_nodes(
    grid: Grid, samples: Samples, force_between: NDArray[np.float64] | None
) -> NodalSamples:
    """Take samples from an exact grid to the nodes, with their forces between these."""
    force = grid.to_nodes(samples.force.numpy()).astype(np.float64)
    displacement = grid.to_nodes(samples.displacement.numpy()).astype(np.float64)
    return NodalSamples(force, displacement, force_between, parameters=samples.parameters)


def joined_parameters(
    parts: Sequence[NDArray[np.float64] | None],
) -> NDArray[np.float64] | None:
    """Parameters of the shapes of several datasets of one body; None of one shape."""
    known = [part for part in parts if part is not None]
    return np.concatenate(known) if known else None


def joined_between(
    parts: Sequence[tuple[int, NDArray[np.float64] | None]],
) -> NDArray[np.float64] | None:
    """Forces between the nodes of several datasets, by their numbers of samples; None without any.

    Those of datasets without are zero beside others.
    """
    shapes = [between.shape[1:] for _, between in parts if between is not None]
    if not shapes:
        return None
    each = [np.zeros((count, *shapes[0])) if own is None else own for count, own in parts]
    return np.concatenate(each)
