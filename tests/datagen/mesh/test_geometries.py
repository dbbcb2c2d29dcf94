"""Meshes of boxes against counts known beforehand; the L-shape against the paper."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from mpi4py import MPI
from pydantic import ValidationError

from datagen.cases.body import Body, make_body
from datagen.cases.case import read_case
from datagen.mesh.distributed_mesh import make_mesh
from datagen.mesh.geometries import Arm, Block, Box, LShape
from shared_schema.grid import Grid


@pytest.mark.parametrize(
    ("elements", "upper", "cell_type"),
    [((15, 3), (4.0, 1.0), "quad"), ((5, 3, 2), (4.0, 1.0, 1.0), "hexahedron")],
)
def test_box(elements: tuple[int, ...], upper: tuple[float, ...], cell_type: str) -> None:
    """∏(n + 1) nodes, ∏ n cells, evenly spaced, each cell of the same positive volume."""
    mesh = make_mesh(Box(lower=(0.0,) * len(upper), upper=upper, elements=elements), MPI.COMM_SELF)
    assert mesh.cell_type == cell_type
    assert len(mesh.coordinates) == np.prod(np.add(elements, 1))
    assert len(mesh.cells) == np.prod(elements)
    for axis, (count, length) in enumerate(zip(elements, upper, strict=True)):
        lines = np.unique(mesh.coordinates[:, axis].round(9))
        assert lines == pytest.approx(np.linspace(0, length, count + 1), abs=1e-9)
    corners = mesh.coordinates[mesh.cells]
    size = np.divide(upper, elements)
    assert np.ptp(corners, axis=1) == pytest.approx(np.tile(size, (len(mesh.cells), 1)))


@pytest.mark.parametrize(("elements", "upper"), [((3, 2), (3.0, 2.0)), ((2, 2, 2), (1.0,) * 3)])
def test_cells_are_in_vtk_order(elements: tuple[int, ...], upper: tuple[float, ...]) -> None:
    """VTK order goes around the bottom face, then the top: neighbours differ along one axis."""
    mesh = make_mesh(Box(lower=(0.0,) * len(upper), upper=upper, elements=elements), MPI.COMM_SELF)
    corners = mesh.coordinates[mesh.cells]
    for face in (corners[:, :4], corners[:, 4:]):
        steps = np.roll(face, -1, axis=1) - face
        assert np.all((np.abs(steps) > 1e-9).sum(axis=2) == 1)
    if len(upper) == 3:
        upward = corners[:, 4:] - corners[:, :4]
        assert np.all((np.abs(upward) > 1e-9).sum(axis=2) == 1)


@pytest.mark.parametrize(
    "wrong",
    [
        {"upper": (4, 0)},
        {"elements": (15, 0)},
        {"elements": (15, 3, 2)},
        {"lower": (0,)},
        {"thickness": 1},
    ],
)
def test_invalid_boxes(wrong: dict[str, Any]) -> None:
    right: dict[str, Any] = {"lower": (0, 0), "upper": (4, 1), "elements": (15, 3)}
    Box.model_validate(right)
    with pytest.raises(ValidationError):
        Box.model_validate(right | wrong)


@pytest.fixture(scope="module")
def lshape() -> Body:
    return make_body(read_case("lshape2d"), MPI.COMM_SELF)


def test_lshape_counts(lshape: Body) -> None:
    """57 quadrilaterals, 80 nodes, 160 DOFs (Table 'datasets'); 4 loaded nodes, 4 clamped."""
    assert len(lshape.mesh.cells) == 57
    assert lshape.mesh.coordinates.size == 160
    assert (lshape.clamped.sum(), lshape.loadable.sum()) == (4, 4)
    loaded = lshape.mesh.coordinates[lshape.loadable]
    assert np.sort(loaded[:, 0]) == pytest.approx([4.8, 5.2, 5.6, 6.0])
    assert loaded[:, 1] == pytest.approx([2.0] * 4)


def test_lshape_grid(lshape: Body) -> None:
    """Zero-padded grid of 16 x 8 = 128 points, 256 DOFs; columns 0.4 m, rows 2/7 m apart."""
    grid = Grid.from_coordinates(lshape.mesh.coordinates)
    assert grid.shape == (16, 8)
    assert grid.mask[:12, 4:].sum() == 0
    assert grid.mask[:, :4].all()
    assert grid.mask[12:].all()
    at = lshape.mesh.coordinates[grid.node_at[12:, :]]
    assert at[:, 0, 0] == pytest.approx([4.8, 5.2, 5.6, 6.0])
    assert at[0, :, 1] == pytest.approx(np.arange(8) * 2 / 7)


def test_lshape_area(lshape: Body) -> None:
    """Arm 4.8 · 6/7 m² and block 1.2 · 2 m², by the shoelace formula for every cell."""
    corners = lshape.mesh.coordinates[lshape.mesh.cells]
    following = np.roll(corners, -1, axis=1)
    cross = corners[..., 0] * following[..., 1] - corners[..., 1] * following[..., 0]
    areas = np.abs(cross.sum(axis=1)) / 2
    assert areas.sum() == pytest.approx(4.8 * 6 / 7 + 1.2 * 2)
    assert areas == pytest.approx(np.full(57, 0.4 * 2 / 7))


def test_arm_and_block_share_a_side(lshape: Body) -> None:
    """No two nodes have the same position."""
    x = lshape.mesh.coordinates
    distance = np.linalg.norm(x[:, None] - x[None, :], axis=2) + np.eye(len(x))
    assert distance.min() > 0.28


def test_arm_is_lower_than_block() -> None:
    with pytest.raises(ValidationError, match="fewer elements along y"):
        LShape(
            arm=Arm(length=4.8, elements=(12, 7)),
            block=Block(width=1.2, height=2, elements=(3, 7)),
        )
