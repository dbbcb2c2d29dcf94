"""The mesh and grid that a surrogate predicts on, carried in its run folder."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from shared_schema.grid import Grid
from shared_schema.grid_arrays import grid_arrays, grid_of
from shared_schema.layout import Arrays

PREFIX = "geometry."


@dataclass(frozen=True)
class Geometry:
    """Mesh, supports and grid of a case.

    Attributes
    ----------
    coordinates : array, (n_nodes, d)
        In m.
    cells : array of int, (n_cells, n_corners)
    cell_type : str
        meshio's name.
    clamped, loadable : array of bool, (n_nodes,)
    grid : Grid
    """

    coordinates: NDArray[np.float64]
    cells: NDArray[np.int64]
    cell_type: str
    clamped: NDArray[np.bool_]
    loadable: NDArray[np.bool_]
    grid: Grid

    @classmethod
    def from_arrays(cls, arrays: Arrays, cell_type: str) -> Geometry:
        """Take the geometry from the arrays of a structured shard."""
        return cls(
            arrays["mesh/coordinates"],
            arrays["mesh/cells"],
            cell_type,
            arrays["mesh/clamped"],
            arrays["mesh/loadable"],
            grid_of(arrays),
        )

    @classmethod
    def from_tensors(cls, tensors: dict[str, Tensor], cell_type: str) -> Geometry:
        """Take the geometry from the result of `tensors`."""
        arrays = {
            name.removeprefix(PREFIX): tensor.numpy()
            for name, tensor in tensors.items()
            if name.startswith(PREFIX)
        }
        grid = grid_of(arrays)
        return cls(**{name: arrays[name] for name in _ARRAYS}, cell_type=cell_type, grid=grid)

    def arrays(self) -> Arrays:
        """Arrays of mesh, supports and grid map by name."""
        return {name: getattr(self, name) for name in _ARRAYS} | grid_arrays(self.grid)

    def tensors(self) -> dict[str, Tensor]:
        """The geometry as named tensors, for the weights file."""
        return {
            PREFIX + name: torch.from_numpy(np.ascontiguousarray(array))
            for name, array in self.arrays().items()
        }

    @property
    def dimension(self) -> int:
        """Number of space dimensions d."""
        return int(self.coordinates.shape[1])

    @property
    def free_mask(self) -> NDArray[np.bool_]:
        """Grid points whose displacement is that of nodes free to move, (nx, ny[, nz])."""
        return self.grid.moved_by(~self.clamped)

    @property
    def tip(self) -> int:
        """The loadable node farthest from the supports."""
        support = self.coordinates[self.clamped]
        candidates = np.flatnonzero(self.loadable)
        distance = np.linalg.norm(
            self.coordinates[candidates][:, None, :] - support[None, :, :], axis=2
        ).min(axis=1)
        return int(candidates[distance.argmax()])


_ARRAYS = ("coordinates", "cells", "clamped", "loadable")
