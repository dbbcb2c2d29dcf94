"""A structured dataset in memory, as tensors."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from shared_schema.common.configuration import validate
from shared_schema.common.errors import InputError
from shared_schema.common.nodal_forces import scatter_forces
from shared_schema.dataset_reader import DatasetReader
from shared_schema.grid import Grid
from shared_schema.manifest import Manifest, StructuredInfo
from shared_schema.material import NeoHookean
from shared_schema.stiffness import Stiffness, read_stiffness
from surrogate.data.geometry import Geometry
from surrogate.data.nodal_dataset import NodalSamples

ON_GRID = ("samples/is_test", "samples/force", "samples/displacement")
AT_NODES = ("samples/loaded_nodes", "samples/nodal_force", "samples/nodal_displacement")


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
        Samples of each split, in ascending order of their number.
    nodal_test : NodalSamples
        The test split by nodes.
    embedded_train : NodalSamples or None
        The training split by nodes, if the grid is embedded and does not hold it exactly.
    stiffness : Stiffness or None
        Stiffness of the undeformed body without supports, if the dataset has it.
    """

    manifest: Manifest
    geometry: Geometry
    train: Samples
    test: Samples
    nodal_test: NodalSamples
    embedded_train: NodalSamples | None = None
    stiffness: Stiffness | None = None

    def nodal_train(self, rows: Tensor) -> NodalSamples:
        """Samples of the training split by nodes, given their rows."""
        if self.embedded_train is None:
            return at_nodes(self.geometry.grid, self.train[rows])
        whole, chosen = self.embedded_train, rows.numpy()
        return NodalSamples(whole.force[chosen], whole.displacement[chosen])

    @property
    def material(self) -> NeoHookean:
        """Material of the body; InputError if the manifest does not name it."""
        given = self.manifest.case.get("material", {})
        return validate(NeoHookean, given, "material of the dataset's case")

    @property
    def info(self) -> StructuredInfo:
        """Grid, split and statistics from the manifest."""
        assert self.manifest.structured is not None
        return self.manifest.structured


def read_dataset(folder: Path) -> Dataset:
    """Read a structured dataset into memory.

    Raises
    ------
    InputError
        If there is no dataset, it is of another kind, or any byte of it has changed.
    """
    reader = DatasetReader(folder, "structured")
    manifest = reader.manifest
    if manifest.samples == 0:
        raise InputError(f"{folder}: no samples in it")
    geometry = Geometry.from_arrays(reader.body, reader.cell_type)
    is_exact = geometry.grid.points_are_nodes
    arrays = reader.joined(ON_GRID if is_exact else (*ON_GRID, *AT_NODES))
    is_test = torch.from_numpy(arrays["samples/is_test"])
    samples = Samples(
        torch.from_numpy(arrays["samples/force"]),
        torch.from_numpy(arrays["samples/displacement"]),
    )
    train, test = samples[~is_test], samples[is_test]
    if is_exact:
        dataset = Dataset(manifest, geometry, train, test, at_nodes(geometry.grid, test))
    else:
        nodes, loads, displacement = (arrays[name] for name in AT_NODES)
        force = scatter_forces(nodes, loads, len(geometry.coordinates))
        chosen = is_test.numpy()
        nodal_train, nodal_test = (
            NodalSamples(force[rows].astype(np.float64), displacement[rows].astype(np.float64))
            for rows in (~chosen, chosen)
        )
        dataset = Dataset(manifest, geometry, train, test, nodal_test, nodal_train)
    if dataset.info.stiffness is None:
        return dataset
    return replace(dataset, stiffness=read_stiffness(folder))


def at_nodes(grid: Grid, samples: Samples) -> NodalSamples:
    """Take samples from an exact grid to the nodes."""
    force, displacement = (
        grid.to_nodes(field.numpy()).astype(np.float64)
        for field in (samples.force, samples.displacement)
    )
    return NodalSamples(force, displacement)
