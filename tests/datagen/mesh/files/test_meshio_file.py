"""Formats that meshio reads: groups, numbers of nodes, and why a file is not read."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import meshio
import numpy as np
import pytest

from shared_schema.common.errors import InputError
from tests.datagen.mesh.files.test_gmsh_file import case_at
from tests.datagen.mesh.test_mesh_file import mesh_at, volume

POINTS = np.array([(0, 0), (1, 0), (2, 0), (0, 1), (1, 1), (2, 1)], float)
CELLS = [("quad", np.array([(0, 1, 4, 3), (1, 2, 5, 4)]))]
NASTRAN = """BEGIN BULK
GRID          31              0.      0.      0.
GRID          12              2.      0.      0.
GRID,7,,2.,1.,0.
GRID*                  5                              0.              1.*
*                     0.
CQUAD4         1      77      31      12       7       5
ENDDATA
"""


def test_families_of_med(tmp_path: Path) -> None:
    """Families of nodes and of cells are groups under their names."""
    mesh: Any = meshio.Mesh(POINTS, CELLS, cell_data={"cell_tags": [np.array([-1, -2])]})
    mesh.point_data = {"point_tags": np.array([3, 0, 0, 3, 0, 0])}
    mesh.point_tags, mesh.cell_tags = {3: ["wall"]}, {-1: ["left half"], -2: ["right half"]}
    mesh.write(tmp_path / "bar.med")
    read = mesh_at(tmp_path / "bar.med")
    assert read.groups["wall"].tolist() == [0, 3]
    assert read.groups["left half"].tolist() == [0, 1, 3, 4]
    assert read.cell_groups["right half"].tolist() == [1]
    support = [{"nodes": [0, 3], "nodes_from": 0}]
    with pytest.raises(InputError, match="numbers of nodes in a file of this format are not read"):
        case_at(tmp_path / "bar.med", supports=support)


def test_numbers_of_cell_data(tmp_path: Path) -> None:
    """Whole numbers are groups, under their array's name as well if there are several arrays."""
    points = np.pad(POINTS, ((0, 0), (0, 1)))
    material = {"material": [np.array([1, 2])]}
    meshio.Mesh(points, CELLS, cell_data=material).write(tmp_path / "one.vtu")
    read = mesh_at(tmp_path / "one.vtu")
    assert read.groups["2"].tolist() == [1, 2, 4, 5]
    assert read.cell_groups["1"].tolist() == [0]
    several = material | {"part": [np.array([5, 5])], "height": [np.array([0.5, 1.5])]}
    meshio.Mesh(points, CELLS, cell_data=several).write(tmp_path / "two.vtu")
    assert sorted(mesh_at(tmp_path / "two.vtu").cell_groups) == [
        "material 1",
        "material 2",
        "part 5",
    ]


def test_numbers_of_a_nastran_file(tmp_path: Path) -> None:
    """Fields of 8 and 16 columns and between commas; the property 77 is a group."""
    path = tmp_path / "tile.bdf"
    path.write_text(NASTRAN)
    mesh = mesh_at(path)
    assert volume(mesh) == 2
    assert mesh.coordinates.tolist() == [[0, 1], [2, 1], [2, 0], [0, 0]]
    assert mesh.cell_groups["77"].tolist() == [0]
    body = case_at(path, supports=[{"nodes": [31, 5], "nodes_from": 1}])
    assert np.array_equal(body.clamped, mesh.coordinates[:, 0] == 0)
    path.write_text(NASTRAN.replace("GRID,7,,", "GRID,7,4,"))
    with pytest.raises(InputError, match="GRID 7: coordinates of the system 4"):
        mesh_at(path)


def test_the_reason_of_meshio(tmp_path: Path) -> None:
    """meshio prints it and exits; an error without a text keeps its kind."""
    (tmp_path / "own.off").write_text("no mesh\n")
    with pytest.raises(InputError, match=r"no mesh with cells in it \(Expected the first line"):
        mesh_at(tmp_path / "own.off")
