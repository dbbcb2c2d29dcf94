"""Directions of fibres on the cells of a rank, for the energies of materials with fibres."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import dolfinx
import numpy as np
import ufl
from numpy.typing import NDArray

from datagen.dolfinx_versions import cell_blocks, functionspace
from datagen.mesh.distributed_mesh import Mesh
from shared_schema.common.errors import InputError
from shared_schema.materials import Material, WithFibres


@dataclass(frozen=True)
class FibreField:
    """Directions of the fibres of all families, constant in each cell.

    Attributes
    ----------
    mesh : Mesh
    values : array, (n_local_cells, families · d)
        Unit vectors of the cells of this rank, ghosts included; 0 for a family that a cell lacks.
    counts : tuple of int
        Number of families of each material.
    """

    mesh: Mesh
    values: NDArray[np.float64]
    counts: tuple[int, ...]

    def function(self) -> Any:
        """Make a UFL coefficient of all vectors, after those that exist."""
        space = functionspace(self.mesh.domain, ("DG", 0, (self.values.shape[1],)))
        function = dolfinx.fem.Function(space, name="fibres")
        width = self.values.shape[1]
        blocks = cell_blocks(space)[:, 0]
        function.x.array.reshape(-1, width)[blocks] = self.values
        return function

    def directions(self, function: Any, material: int) -> list[Any]:
        """Unit vectors of the families of a material, as UFL vectors with d components."""
        d = self.mesh.coordinates.shape[1]
        return [
            ufl.as_vector([function[family * d + i] for i in range(d)])
            for family in range(self.counts[material])
        ]


def fibre_field(
    mesh: Mesh,
    materials: Sequence[Material],
    parts: NDArray[np.int64] | None,
    fibres: NDArray[np.float64] | None,
) -> FibreField | None:
    """Distribute the directions of fibres; None if no material has any.

    Parameters
    ----------
    mesh : Mesh
    materials : sequence of Material
    parts : array of int, (n_cells,), or None
        Position of each cell's material; all are of the first by default.
    fibres : array, (n_cells, families, d), or None
        Unit vectors in the undeformed body.

    Raises
    ------
    InputError
        If a material has another number of families than its energy takes.
    """
    of_cells = np.zeros(len(mesh.cells), dtype=np.int64) if parts is None else parts
    none = np.zeros((len(mesh.cells), 0))
    there = none if fibres is None else np.linalg.norm(fibres, axis=2) > 0
    counts = []
    for number, material in enumerate(materials):
        own = there[of_cells == number]
        fewest, most = material.family_range if isinstance(material, WithFibres) else (0, 0)
        count = min(int(own.all(axis=0).sum()), most) if len(own) else fewest
        if count < fewest:
            raise InputError(
                f"material '{material.model}': every cell has {count} directions of fibres, "
                f"expected {fewest} at least"
            )
        counts.append(count)
    if fibres is None or not any(counts):
        return None
    local = mesh.of_local_cells(fibres)
    return FibreField(mesh, local.reshape(len(local), -1), tuple(counts))
