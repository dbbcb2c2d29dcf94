from __future__ import annotations

from pathlib import Path

import meshio
import numpy as np
import pytest

from shared_schema.common.errors import InputError
from shared_schema.common.solution_file import require_suffix, write_solution

PLANE = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 1.0], [0.0, 1.0]])
QUAD = np.array([[0, 1, 2, 3]])
TETRA = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])


def fields_like(coordinates: np.ndarray) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(6)
    return {name: rng.normal(size=coordinates.shape) for name in ("force", "displacement", "std")}


def test_npz(tmp_path: Path) -> None:
    fields = fields_like(PLANE)
    write_solution(tmp_path / "u.npz", PLANE, QUAD, "quad", fields)
    with np.load(tmp_path / "u.npz", allow_pickle=False) as found:
        assert sorted(found) == ["coordinates", "displacement", "force", "std"]
        np.testing.assert_array_equal(found["coordinates"], PLANE)
        for name, values in fields.items():
            np.testing.assert_array_equal(found[name], values)
    assert [path.name for path in tmp_path.iterdir()] == ["u.npz"]


@pytest.mark.parametrize("suffix", [".vtu", ".xdmf"])
@pytest.mark.parametrize(
    ("coordinates", "cell_type"), [(PLANE, "quad"), (TETRA, "tetra")], ids=["2d", "3d"]
)
def test_meshio_reads_it_back(
    tmp_path: Path, suffix: str, coordinates: np.ndarray, cell_type: str
) -> None:
    fields = fields_like(coordinates)
    path = tmp_path / f"u{suffix}"
    write_solution(path, coordinates, QUAD, cell_type, fields)
    found = meshio.read(path)
    dimension = coordinates.shape[1]
    assert found.cells[0].type == cell_type
    np.testing.assert_array_equal(found.cells[0].data, QUAD)
    for values, expected in [
        (found.points, coordinates),
        *((found.point_data[name], fields[name]) for name in fields),
    ]:
        assert values.shape == (4, 3)
        np.testing.assert_allclose(values[:, :dimension], expected, rtol=1e-15, atol=1e-15)
        assert not values[:, dimension:].any()
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("name", ["u.vtk", "u", "u.npz.gz", "u.NPZ"])
def test_wrong_suffix(tmp_path: Path, name: str) -> None:
    with pytest.raises(InputError, match=r"ending in \.npz, \.vtu, \.xdmf"):
        write_solution(tmp_path / name, PLANE, QUAD, "quad", fields_like(PLANE))
    assert list(tmp_path.iterdir()) == []


def test_missing_folder(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such folder"):
        require_suffix(tmp_path / "nowhere" / "u.npz")
    assert not (tmp_path / "nowhere").exists()


def test_failure_leaves_no_file(tmp_path: Path) -> None:
    with pytest.raises(KeyError):
        write_solution(tmp_path / "u.vtu", PLANE, QUAD, "no cell", fields_like(PLANE))
    assert list(tmp_path.iterdir()) == []
