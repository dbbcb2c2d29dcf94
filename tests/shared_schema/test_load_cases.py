"""Load cases as they are written and read."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from shared_schema.common.errors import InputError
from shared_schema.load_cases import LoadCases, read_load_cases, write_load_cases

X = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
FORCES = np.zeros((2, 3, 2))
FORCES[0, 2] = 1.0, -2.0
FORCES[1, 0], FORCES[1, 1] = (3.0, 0.0), (0.0, 4.0)


def test_written_and_read(tmp_path: Path) -> None:
    path = tmp_path / "loads.h5"
    write_load_cases(path, LoadCases.of(X, FORCES), "0" * 64, "triangle")
    found = read_load_cases(path)
    np.testing.assert_array_equal(found.coordinates, X)
    assert len(found) == 2
    nodes, forces = found.load(0)
    assert (nodes.tolist(), forces.tolist()) == ([2], [[1.0, -2.0]])
    nodes, forces = found.load(1)
    assert (nodes.tolist(), forces.tolist()) == ([0, 1], [[3.0, 0.0], [0.0, 4.0]])


def test_nodes_that_are_not_there(tmp_path: Path) -> None:
    path = tmp_path / "loads.h5"
    write_load_cases(path, LoadCases(X, np.array([[3]]), np.ones((1, 1, 2))), "0" * 64, "triangle")
    with pytest.raises(InputError, match="names a node outside 0 … 2"):
        read_load_cases(path)


def test_no_load_cases(tmp_path: Path) -> None:
    path = tmp_path / "loads.h5"
    write_load_cases(path, LoadCases.of(X, FORCES[:0]), "0" * 64, "triangle")
    with pytest.raises(InputError, match="no load cases in it"):
        read_load_cases(path)
