"""The shipped L-shape against the paper and its authors' scripts."""

from __future__ import annotations

import numpy as np
import pytest
from mpi4py import MPI
from pydantic import ValidationError

from datagen.cases.body import Body, make_body
from datagen.cases.case import read_case
from datagen.mesh.lshape import Arm, Block, LShape
from shared_schema.grid import Grid


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
