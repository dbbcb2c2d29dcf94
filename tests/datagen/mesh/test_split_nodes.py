"""Two blocks beside each other, of 2 × 1 m each, with nodes of their own at x = 2."""

from __future__ import annotations

import logging
from pathlib import Path

import meshio
import numpy as np
import pytest

import datagen
from datagen.mesh.split_nodes import split_warning
from tests.datagen.mesh.files.test_gmsh_file import case_at

X = np.array([(0.0, 0.0), (2.0, 0.0), (2.0, 1.0), (0.0, 1.0)])


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
