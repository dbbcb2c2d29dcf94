"""Small bodies of every cell type: boxes of 2 × 1 [× 1] m that are clamped at x = 0."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from shared_schema.grid import Grid
from shared_schema.materials import NeoHookean
from surrogate.learning.data.dataset import Dataset
from surrogate.learning.data.samples import Samples
from surrogate.mechanics.body.geometry import Geometry
from surrogate.mechanics.series.series_response import SeriesResponse
from tests.surrogate.conftest import box_cells

MATERIAL = NeoHookean(young_modulus=500, poisson_ratio=0.4)
TRIANGLES = np.array([[0, 1, 2], [0, 2, 3]])  # of a quadrilateral
TETRAHEDRA = np.array(  # of a hexahedron, around its diagonal from corner 0 to corner 6
    [[0, 1, 2, 6], [0, 2, 3, 6], [0, 3, 7, 6], [0, 7, 4, 6], [0, 4, 5, 6], [0, 5, 1, 6]]
)


def cells_of(cell_type: str, shape: tuple[int, ...]) -> np.ndarray:
    """Cells of a box with so many nodes along each axis, cut into simplices if they are such."""
    cells = box_cells(shape)
    if cell_type in ("quad", "hexahedron"):
        return cells
    parts = TRIANGLES if cell_type == "triangle" else TETRAHEDRA
    return cells[:, parts].reshape(-1, parts.shape[1])


def box(cell_type: str) -> Geometry:
    """A body of 7 × 4 nodes in the plane or 5 × 3 × 3 in space."""
    shape = (7, 4) if cell_type in ("quad", "triangle") else (5, 3, 3)
    size = (2.0, 1.0, 1.0)[: len(shape)]
    coordinates = np.argwhere(np.ones(shape)) / (np.array(shape) - 1) * size
    return Geometry(
        coordinates=coordinates,
        cells=cells_of(cell_type, shape),
        cell_type=cell_type,
        clamped=coordinates[:, 0] == 0,
        loadable=coordinates[:, 0] > 0,
        grid=Grid.from_coordinates(coordinates),
    )


def zoned(cell_type: str) -> tuple[Geometry, tuple[NeoHookean, NeoHookean]]:
    """The same body, whose half at the free end has a third of the modulus."""
    geometry = box(cell_type)
    half = (geometry.coordinates[geometry.cells, 0].mean(axis=1) > 1).astype(int)
    soft = MATERIAL.model_copy(update={"young_modulus": MATERIAL.young_modulus / 3})
    return replace(geometry, parts=half), (MATERIAL, soft)


def with_zones(dataset: Dataset) -> Dataset:
    """The same samples for a body whose free end is of another group; nobody looks at them."""
    geometry = dataset.geometry
    middle = geometry.coordinates[geometry.cells, 0].mean(axis=1)
    parts = (middle > np.median(middle)).astype(np.int64)
    material = {**dataset.manifest.case["material"]}
    materials = [{**material, "group": "root"}, {**material, "group": "end"}]
    case = {**dataset.manifest.case, "material": materials}
    manifest = dataset.manifest.model_copy(update={"case": case})
    return replace(dataset, geometry=replace(geometry, parts=parts), manifest=manifest)


def end_load(geometry: Geometry, *force: float) -> np.ndarray:
    """Return a force in N at the last node, the corner farthest from the origin."""
    forces = np.zeros_like(geometry.coordinates)
    forces[-1] = force
    return forces


def in_equilibrium(dataset: Dataset) -> Dataset:
    """The dataset with the displacements of a series of sixth order, in memory."""
    response = SeriesResponse(dataset.geometry, dataset.material, gradient=False, order=6)

    def solved(samples: Samples) -> Samples:
        return Samples(samples.force, response(samples.force)[0])

    return replace(dataset, train_in_memory=solved(dataset.train), test=solved(dataset.test))


def as_simplices(geometry: Geometry) -> Geometry:
    """The same body with triangles in place of quadrilaterals, tetrahedra of hexahedra."""
    name, parts = ("triangle", TRIANGLES) if geometry.dimension == 2 else ("tetra", TETRAHEDRA)
    cells = geometry.cells[:, parts].reshape(-1, parts.shape[1])
    return replace(geometry, cells=cells, cell_type=name)
