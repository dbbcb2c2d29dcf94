"""Cells that lie over others without a facet in common, and bodies that are split."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Any

import meshio
import numpy as np
import pytest

import datagen
from datagen.mesh.overlap import overlap_problem, split_warning
from shared_schema.common.bodies.cells import conformity_problem
from tests.datagen.mesh.files.test_gmsh_file import case_at
from tests.datagen.solver.cantilever import box

X = np.array([(0.0, 0.0), (2.0, 0.0), (2.0, 1.0), (0.0, 1.0)])


def ring(angle: float) -> tuple[Any, Any]:
    """A band of 60 quadrilaterals between the radii 1 and 2, over an angle."""
    along = np.linspace(0, angle, 61)
    circle = np.stack([np.cos(along), np.sin(along)], axis=1)
    number = np.arange(60)
    cells = np.stack([number, number + 61, number + 62, number + 1], axis=1)
    return np.concatenate([circle, 2 * circle]), cells


def test_a_band_that_goes_round_further_than_once() -> None:
    """Each cell fits its neighbours; those of the last half turn lie over the first 20."""
    x, cells = ring(1.99 * np.pi)
    assert overlap_problem(x, cells, "quad") is None
    x, cells = ring(3 * np.pi)
    assert conformity_problem(x, cells, "quad") is None
    found = str(overlap_problem(x, cells, "quad"))
    assert found.startswith("40 cells (0, 1, 2, 3, 4, 5, …): they overlap (cell 0 at 1.49077,0.117")
    assert "lies over cell 40), expected cells that only touch" in found


@pytest.mark.parametrize("simplices", [False, True])
@pytest.mark.parametrize("d", [2, 3])
def test_two_blocks(d: int, simplices: bool) -> None:
    """Beside each other, one in the other, one over the other, and through each other a little."""
    one = box((1.0,) * d, (4,) * d, simplices)
    other = one.cells + len(one.coordinates)
    cells = np.concatenate([one.cells, other])

    def found(second: Any) -> str | None:
        return overlap_problem(np.concatenate([one.coordinates, second]), cells, one.cell_type)

    x = one.coordinates
    across = np.eye(d)[0]
    assert found(x + across) is None
    assert found(x + (1 + 1e-9) * across) is None
    assert found(x + 0.99 * across) is not None  # 0.04 of a cell deep
    assert found(x) is not None
    assert found(0.1 * x + 0.43) is not None
    assert found(np.where(x > 0, 9.0, -9.0) * (np.abs(x) + 1)) is not None


def test_a_distorted_mesh_of_hexahedra_is_fine() -> None:
    """All nodes moved by a fifth of an edge: faces are not plane, and no cell is over another."""
    mesh = box((1.0, 1.0, 1.0), (6, 6, 6), False)
    moves = np.random.default_rng(3).uniform(-0.2 / 6, 0.2 / 6, mesh.coordinates.shape)
    x = mesh.coordinates + moves
    assert conformity_problem(x, mesh.cells, "hexahedron") is None
    assert overlap_problem(x, mesh.cells, "hexahedron") is None


def test_coarse_and_fine_cells() -> None:
    """A tip of a large triangle in the middle of a patch of small ones, and beside it."""
    fine = box((0.1, 0.1), (20, 20), True)
    count = len(fine.coordinates)
    cells = np.concatenate([fine.cells, [[count, count + 1, count + 2]]])
    for tip, words in ((0.0513, "lies over cell 800"), (0.1001, "None")):
        large = np.array([[tip, 0.05], [50, -20], [50, 20]])
        x = np.concatenate([fine.coordinates, large])
        assert words in str(overlap_problem(x, cells, "triangle"))


def test_a_split_body_is_solved_with_a_warning(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """The block on the right bears the force alone."""
    x = np.vstack((X, X + np.array([2, 0])))
    path = tmp_path / "blocks.vtu"
    blocks = [("quad", np.arange(8).reshape(2, 4))]
    meshio.Mesh(np.column_stack((x, np.zeros(8))), blocks).write(path)
    case_at(path, supports=[{"x": 0}, {"x": 4}])
    with caplog.at_level(logging.WARNING):
        found = datagen.solve(tmp_path / "own.yaml", force(7))
    assert "4 nodes share their places with others, the first at 2,0: the body is split" in (
        caplog.text
    )
    assert not found.displacement[:4].any()


def force(node: int) -> np.ndarray:
    load = np.zeros((8, 2))
    load[node, 1] = -1.0
    return load


def test_where_nodes_are_one() -> None:
    assert split_warning(X) is None
    near = np.vstack((X, X[2] + 1e-6))  # a millionth of a metre away, on purpose
    assert split_warning(near) is None
    assert split_warning(1e-6 * np.vstack((X, X[2] + 1e-12))) is not None
