"""Samples in memory: on the grid, and by nodes with the numbering of the finite-element mesh."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from shared_schema.common.bodies.nodal_forces import scatter_forces
from shared_schema.common.errors import InputError
from shared_schema.manifest import Manifest

if TYPE_CHECKING:
    from shared_schema.dataset_reader import DatasetReader

Location = Literal["auto", "device", "host", "disk"]  # memory of the samples during a training
Array = NDArray[np.float64]
BETWEEN, PARAMETERS = "samples/force_between", "samples/parameters"


@dataclass(frozen=True)
class Samples:
    """Forces and the displacements that they cause, on the grid.

    Attributes
    ----------
    force : Tensor, (N, d, nx, ny[, nz])
        In N.
    displacement : Tensor, (N, d, nx, ny[, nz])
        In m.
    parameters : array, (N, n_parameters), or None
        Those of every sample's shape; None of one shape.
    """

    force: Tensor
    displacement: Tensor
    parameters: Array | None = field(default=None, kw_only=True)

    def __len__(self) -> int:
        return len(self.force)

    def __getitem__(self, index: Tensor | slice) -> Samples:
        parameters = self.parameters
        if parameters is not None:
            parameters = parameters[index if isinstance(index, slice) else index.cpu().numpy()]
        return Samples(self.force[index], self.displacement[index], parameters=parameters)

    def subset(self, rows: Tensor) -> Samples:
        """Some of the samples, given their ascending rows; all of them are not copied."""
        return self if len(rows) == len(self) else self[rows]

    def in_memory(self) -> Samples:
        """The samples themselves."""
        return self

    def order(self, generator: torch.Generator) -> Tensor:
        """Random order of the samples for a training."""
        return torch.randperm(len(self), generator=generator)

    def to(self, device: torch.device) -> Samples:
        """The same samples on a device."""
        fields = self.force.to(device), self.displacement.to(device)
        return Samples(*fields, parameters=self.parameters)


@dataclass(frozen=True)
class NodalSamples:
    """Forces and the displacements that they cause.

    Attributes
    ----------
    force : array, (N, n_nodes, d)
        In N.
    displacement : array, (N, n_nodes, d)
        In m.
    force_between : array, (N, n_between, d), or None
        Forces between the nodes in N, which `force` contains; None where there are none.
    parameters : array, (N, n_parameters), or None
        Those of every sample's shape; None of one shape.
    """

    force: Array
    displacement: Array
    force_between: Array | None = None
    parameters: Array | None = field(default=None, kw_only=True)

    @property
    def load(self) -> Array:
        """All forces, those between the nodes after the nodal ones: what certificates take."""
        parts = [self.force] if self.force_between is None else [self.force, self.force_between]
        return np.concatenate(parts, axis=1)


@dataclass(frozen=True)
class NodalDataset:
    """A nodal dataset, whole.

    Attributes
    ----------
    manifest : Manifest
    coordinates : array, (n_nodes, d)
        In m.
    samples : NodalSamples
        Solved samples, in ascending order of their number.
    """

    manifest: Manifest
    coordinates: Array
    samples: NodalSamples


def read_nodal_dataset(folder: str | Path) -> NodalDataset:
    """Read the solved samples of a nodal dataset.

    Raises
    ------
    InputError
        If there is no dataset, it is of another kind, or any byte of it has changed.
    """
    from shared_schema.dataset_reader import DatasetReader

    reader = DatasetReader(Path(folder), "nodal")
    if reader.manifest.samples == 0:
        raise InputError(f"{folder}: no samples in it")
    names = ("samples/loaded_nodes", "samples/force", "samples/displacement")
    arrays = reader.joined((*names, *further_in(reader)))
    coordinates = reader.body["mesh/coordinates"]
    force = scatter_forces(
        arrays["samples/loaded_nodes"], arrays["samples/force"], len(coordinates)
    )
    fields = force, arrays["samples/displacement"], arrays.get(BETWEEN)
    samples = NodalSamples(*fields, parameters=arrays.get(PARAMETERS))
    return NodalDataset(reader.manifest, coordinates, samples)


def further_in(reader: DatasetReader) -> tuple[str, ...]:
    """Names of forces between the nodes and of parameters of shapes, if a dataset has some."""
    return tuple(name for name in (BETWEEN, PARAMETERS) if reader.has(name))
