"""Mirror images of samples: linear elasticity of a symmetric body is the same in the mirror."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from shared_schema.common.errors import InputError
from shared_schema.grid import Grid
from surrogate.learning.data.dataset import Dataset
from surrogate.learning.data.mirror import mirror_images, with_mirror_images
from surrogate.learning.data.samples import Samples
from surrogate.mechanics.body.geometry import Geometry
from surrogate.mechanics.equilibrium.linear_response import LinearResponse


def symmetric(geometry: Geometry) -> Geometry:
    """The same body, loadable everywhere."""
    return replace(geometry, loadable=~geometry.clamped)


@pytest.mark.parametrize("name", ["dataset", "dataset_3d"])
def test_mirrored_solutions_are_solutions(name: str, request: pytest.FixtureRequest) -> None:
    """The linear response to the mirrored force is the mirrored displacement."""
    data: Dataset = request.getfixturevalue(name)
    geometry = symmetric(data.geometry)
    response = LinearResponse(geometry, data.material, gradient=False)
    force = torch.randn(3, geometry.dimension, *geometry.grid.shape)
    displacement, _ = response(force)
    axes = ("y",) if geometry.dimension == 2 else ("y", "z")
    both = with_mirror_images(Samples(force, displacement), geometry, axes, "mirrors")
    assert len(both) == 3 * 2 ** len(axes)
    assert torch.equal(both.force[:3], force)
    assert not torch.equal(both.force[3:6], force)
    expected, _ = response(both.force)
    torch.testing.assert_close(both.displacement, expected, rtol=1e-3, atol=1e-5)


def test_the_image_of_the_image_is_the_node(dataset_3d: Dataset) -> None:
    geometry = symmetric(dataset_3d.geometry)
    for axis in ("y", "z"):
        image = mirror_images(geometry, axis, "mirrors")
        assert np.array_equal(image[image], np.arange(len(image)))
        k = "xyz".index(axis)
        total = geometry.coordinates[:, k] + geometry.coordinates[image, k]
        np.testing.assert_allclose(total, np.ptp(geometry.coordinates[:, k]))


def moved(geometry: Geometry) -> Geometry:
    coordinates = geometry.coordinates.copy()
    coordinates[-1] += 0.01
    return replace(geometry, coordinates=coordinates)


def cut(geometry: Geometry) -> Geometry:
    return replace(geometry, cells=geometry.cells[1:])


def sliding(geometry: Geometry) -> Geometry:
    """A node of the edge is held along x, and its image is not."""
    held = geometry.held.copy()
    held[-1, 0] = True
    return replace(geometry, single=held)


def of_two_materials(geometry: Geometry) -> Geometry:
    parts = np.zeros(len(geometry.cells), dtype=np.int64)
    parts[0] = 1
    return replace(geometry, parts=parts)


def embedded(geometry: Geometry) -> Geometry:
    grid = geometry.grid
    halves = np.full((*grid.shape, 2), 0.5)
    sources = np.repeat(grid.sources, 2, axis=-1)
    return replace(geometry, grid=Grid(sources, halves, grid.points, grid.point_weights))


@pytest.mark.parametrize(
    ("change", "axis", "part"),
    [
        (lambda g: g, "y", "its loadable nodes are not"),
        (lambda g: symmetric(g), "x", "its supports are not"),
        (lambda g: symmetric(g), "z", "expected one of ('x', 'y')"),
        (lambda g: moved(symmetric(g)), "y", "has no mirror image"),
        (lambda g: cut(symmetric(g)), "y", "its cells are not mirror images of each other"),
        (lambda g: sliding(symmetric(g)), "y", "its supports are not"),
        (lambda g: of_two_materials(symmetric(g)), "y", "its materials are not"),
        (lambda g: embedded(symmetric(g)), "y", "embedded on its mesh"),
    ],
)
def test_it_is_checked_not_believed(change, axis: str, part: str, dataset: Dataset) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(InputError) as error:
        with_mirror_images(dataset.test, change(dataset.geometry), (axis,), "key 'mirrors'")
    assert part in str(error.value)
