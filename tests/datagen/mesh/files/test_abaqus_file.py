"""Abaqus input: types of elements, numbers, sets, instances at their places."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from shared_schema.common.errors import InputError
from tests.datagen.mesh.files.test_gmsh_file import case_at
from tests.datagen.mesh.test_mesh_file import mesh_at, volume

TILE = """*NODE
 11, 0., 0.
 5, 2., 0.
 7, 2.D0, 1.
 3, 0., 1.
*Element, type=CPE4R, elset=tile
 1, 11, 5, 7, 3
*NSET, NSET=wall
 11, 3
*NSET, NSET=row, GENERATE
 3, 7, 2
"""
PART = TILE.replace("*NODE", "*PART, NAME=Tile\n*NODE") + "*END PART\n*ASSEMBLY, NAME=A\n"
TURNED = """*INSTANCE, NAME=one, PART=TILE
*END INSTANCE
*INSTANCE, NAME=two, PART=Tile
 1., 0., 0.
 3., 0., 0., 3., 0., 1., 90.
*END INSTANCE
*NSET, NSET=held, INSTANCE=one
 11
*END ASSEMBLY
"""


def written(folder: Path, text: str) -> Path:
    (folder / "own.inp").write_text(text)
    return folder / "own.inp"


def test_a_plane_strain_element(tmp_path: Path) -> None:
    """Nodes stand in the order of their numbers, 3, 5, 7, 11."""
    mesh = mesh_at(written(tmp_path, TILE))
    assert (mesh.cell_type, volume(mesh)) == ("quad", 2)
    assert mesh.coordinates.tolist() == [[0, 1], [2, 0], [2, 1], [0, 0]]
    assert mesh.groups["wall"].tolist() == [0, 3]
    assert mesh.groups["row"].tolist() == [0, 1, 2]
    assert mesh.cell_groups["tile"].tolist() == [0]
    body = case_at(tmp_path / "own.inp", supports=[{"nodes": [11, 3], "nodes_from": 1}])
    assert np.array_equal(body.clamped, mesh.coordinates[:, 0] == 0)


@pytest.mark.parametrize("zero", ["", " ", "0"])
def test_empty_coordinates_are_zero(zero: str, tmp_path: Path) -> None:
    """In the plane x, z of a block, all of y may be left out."""
    text = f"*NODE\n1,,{zero},{zero}\n2, 2.,{zero}\n3, 2., 1.,\n4, {zero}, 1.\n"
    mesh = mesh_at(written(tmp_path, f"{text}*ELEMENT, TYPE=CPE4\n1, 1, 2, 3, 4\n"))
    assert mesh.coordinates.tolist() == [[0, 0], [2, 0], [2, 1], [0, 1]]


def test_instances_stand_at_their_places(tmp_path: Path) -> None:
    """The second is moved by 1 m, then turned by 90° about (3, 0): 1 to 3 → x 2 to 3, y −2 to 0.

    The corner (0, 0) goes to (1, 0), then to (3, −2); the corner (2, 1) to (3, 1), then to (2, 0).
    """
    mesh = mesh_at(written(tmp_path, PART + TURNED))
    assert volume(mesh) == pytest.approx(4)
    second = mesh.coordinates[4:]
    assert second[0] == pytest.approx([3, -2])
    assert second[2] == pytest.approx([2, 0])
    assert mesh.groups["two.wall"].tolist() == [4, 7]
    assert mesh.coordinates[mesh.groups["one.held"]].tolist() == [[0, 0]]
    assert sorted(mesh.cell_groups) == ["one.tile", "two.tile"]
    support = [{"nodes": [11], "nodes_from": 1}]
    with pytest.raises(InputError, match=r"key 'supports\.0': nodes: the numbers of nodes"):
        case_at(tmp_path / "own.inp", supports=support)


def test_one_instance_keeps_names_and_numbers(tmp_path: Path) -> None:
    """A translation of 5 m along x alone."""
    one = "*INSTANCE, NAME=one, PART=Tile\n 5., 0., 0.\n*END INSTANCE\n*END ASSEMBLY\n"
    body = case_at(
        written(tmp_path, PART + one), supports=[{"group": "wall"}, {"nodes": [7], "nodes_from": 1}]
    )
    assert body.mesh.coordinates[body.clamped].tolist() == [[5, 1], [7, 1], [5, 0]]


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("CPE4R", "COH2D4", "line 6: elements of type COH2D4 are not read, expected solids"),
        (" 5, 2., 0.", " 11, 2., 0.", "line 1: node 11 stands there twice"),
        (" 1, 11, 5, 7, 3", " 1, 11, 5, 7, 3\n 1, 11, 5, 7, 3", "element 1 stands there twice"),
        (" 1, 11, 5, 7, 3", " 1, 11, 5, 7, 4", "element 1: no node 4 in the file"),
        (" 1, 11, 5, 7, 3", " 1, 11, 5, 7", "line 6: 4 numbers, expected 5 for every CPE4R"),
        (" 11, 3", " left", "line 8: no set 'left' before it"),
        ("*NSET, NSET=wall", "*NGEN\n*NSET, NSET=wall", r"line 8: \*NGEN is not read"),
        ("*NODE", "*INCLUDE, INPUT=nodes.inp\n*NODE", r"line 1: \*INCLUDE is not read"),
        ("*NODE", "*NODE, INPUT=nodes.txt", r"\*NODE of another file"),
        ("*NODE", "*NODE, SYSTEM=C", "cylindrical or spherical"),
        ("CPE4R", "CAX4", "line 6: elements of type CAX4 are of a body of revolution"),
        ("*NSET, NSET=wall", "*TIE, NAME=t\na, b\n*NSET, NSET=wall", r"line 8: \*TIE is not read"),
    ],
)
def test_what_is_not_read(old: str, new: str, said: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=rf"key 'mesh.path' = 'own.inp': .*{said}"):
        mesh_at(written(tmp_path, TILE.replace(old, new)))
