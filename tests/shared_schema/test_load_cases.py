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
    write_load_cases(path, LoadCases.of(X, FORCES), "triangle")
    found = read_load_cases(path)
    np.testing.assert_array_equal(found.coordinates, X)
    assert len(found) == 2
    nodes, forces = found.load(0)
    assert (nodes.tolist(), forces.tolist()) == ([2], [[1.0, -2.0]])
    nodes, forces = found.load(1)
    assert (nodes.tolist(), forces.tolist()) == ([0, 1], [[3.0, 0.0], [0.0, 4.0]])


def test_forces_between_the_nodes(tmp_path: Path) -> None:
    between = np.arange(6.0 * len(FORCES)).reshape(len(FORCES), 3, 2)
    write_load_cases(tmp_path / "loads.h5", LoadCases.of(X, FORCES, between), "triangle")
    found = read_load_cases(tmp_path / "loads.h5").between
    assert found is not None
    np.testing.assert_array_equal(found, between)


def test_nodes_that_are_not_there(tmp_path: Path) -> None:
    path = tmp_path / "loads.h5"
    write_load_cases(path, LoadCases(X, np.array([[3]]), np.ones((1, 1, 2))), "triangle")
    with pytest.raises(InputError, match="names a node outside 0 … 2"):
        read_load_cases(path)


def test_no_load_cases(tmp_path: Path) -> None:
    path = tmp_path / "loads.h5"
    write_load_cases(path, LoadCases.of(X, FORCES[:0]), "triangle")
    with pytest.raises(InputError, match="no load cases in it"):
        read_load_cases(path)


def test_damage_is_found_before_hdf5_sees_it(tmp_path: Path) -> None:
    """Damaged metadata can crash HDF5 itself."""
    path, random = tmp_path / "loads.h5", np.random.default_rng(0)
    write_load_cases(path, LoadCases.of(X, FORCES), "triangle")
    content = path.read_bytes()
    for _ in range(50):
        damaged = bytearray(content)
        damaged[random.integers(len(content))] ^= 1 << random.integers(8)
        path.write_bytes(damaged)
        with pytest.raises(InputError, match="its checksum does not match"):
            read_load_cases(path)
    for length in (0, 30, len(content) // 2, len(content) - 1):
        path.write_bytes(content[:length])
        with pytest.raises(InputError, match="its checksum does not match"):
            read_load_cases(path)
