"""Zones of a body by closed surfaces."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from datagen.cases.case import read_case
from datagen.cases.placed_body import placed
from datagen.mesh.mesh_file import MeshFile
from shared_schema.common.bodies.groups import RawMesh
from shared_schema.common.errors import InputError
from tests.closed_surfaces import CUBE, FACES, ball, surface_file
from tests.datagen.mesh.test_mesh_file import CASE, SQUARE, volume
from tests.datagen.refusal import refusal


def organ(folder: Path, zones: dict[str, str], size: float = 0.5, **keys: Any) -> RawMesh:
    """A cube of 2 m with zones, in cells of 0.25 m; all lengths of the files are in half metres."""
    surface_file(folder / "organ.stl", 4 * CUBE - 2)
    wanted = MeshFile(kind="file", path="organ.stl", size=size, scale=0.5, zones=zones, **keys)
    return wanted.found_from(folder).raw_mesh()


def of_cells(mesh: RawMesh, name: str) -> RawMesh:
    return RawMesh(mesh.coordinates, mesh.cells[mesh.cell_groups[name]], mesh.cell_type)


def test_a_ball_in_a_cube(tmp_path: Path) -> None:
    """A ball of 0.5 m has 4/3 π 0.5³; cells of 0.25 m, each in or out, meet it to 8 %."""
    (tmp_path / "zones").mkdir()
    points, triangles = ball(400)
    surface_file(tmp_path / "zones" / "tumour.ply", points, triangles)
    surface_file(tmp_path / "left.obj", CUBE * [0.8, 9, 9] - [2.1, 3, 3])
    mesh = organ(tmp_path, {"tumour": "zones/tumour.ply", "left": "left.obj"})
    assert volume(of_cells(mesh, "tumour")) == pytest.approx(np.pi / 6, rel=0.08)
    assert volume(of_cells(mesh, "left")) == pytest.approx(0.35 * 4, rel=0.1)  # cut by the body
    whole = sum(volume(of_cells(mesh, name)) for name in ("tumour", "left", "rest"))
    assert whole == pytest.approx(volume(mesh), rel=1e-9)
    inside = mesh.coordinates[mesh.groups["tumour"]]
    assert np.linalg.norm(inside, axis=1).max() < 0.5 + 0.3  # edges are up to a fifth longer
    finer = organ(tmp_path, {"tumour": "zones/tumour.ply"}, refine=1)
    assert len(finer.cell_groups["tumour"]) == 8 * len(mesh.cell_groups["tumour"])


def test_a_zone_has_its_own_material(tmp_path: Path) -> None:
    surface_file(tmp_path / "tumour.stl", *ball(100))
    surface_file(tmp_path / "organ.stl", 4 * CUBE - 2)
    case = {
        **CASE,
        "mesh": {
            "kind": "file",
            "path": str(tmp_path / "organ.stl"),
            "size": 1,
            "zones": {"tumour": str(tmp_path / "tumour.stl")},
        },
        "material": [
            {"group": "tumour", "young_modulus": 3e4, "poisson_ratio": 0.4},
            {"group": "rest", "young_modulus": 3e3, "poisson_ratio": 0.4},
        ],
        "supports": [{"z": -2}],
        "load": {"family": "body_force", "range": [-1, 1]},
    }
    read = read_case(case)
    parts = placed(read, read.mesh.raw_mesh()).parts
    assert parts is not None
    assert 0 < (parts == 0).mean() < 0.15  # 4.2 of 64 m³
    surface_file(tmp_path / "tumour.stl", *ball(101))
    assert read_case(case).digest() != read.digest()  # another zone is another case
    material = {"young_modulus": 3e3, "poisson_ratio": 0.4}
    with pytest.raises(
        InputError, match=r"key 'mesh\.zones\.tumour': no material, load or support"
    ):
        read_case({**case, "material": material})
    load = {"family": "body_force", "region": {"group": "tumour"}, "range": [-1, 1]}
    read_case({**case, "material": material, "load": load})


@pytest.mark.parametrize(
    ("zones", "said"),
    [
        ({"a": "far.stl"}, r"key 'mesh\.zones\.a': it lies outside of the body"),
        ({"a": "tiny.stl"}, r"key 'mesh\.zones\.a': no cell has its centre in it, .* smaller"),
        ({"a": "open.stl"}, r"key 'mesh\.zones\.a': .*open\.stl: expected a closed surface"),
        ({"a": "ball.stl", "b": "ball.stl"}, r"zones\.b': it overlaps with zone 'a' at "),
        ({"a": "none.stl"}, r"key 'mesh\.zones\.a': no such file "),
    ],
)
def test_what_is_no_zone(zones: dict[str, str], said: str, tmp_path: Path) -> None:
    surface_file(tmp_path / "ball.stl", *ball(100))
    surface_file(tmp_path / "far.stl", CUBE + 3)
    surface_file(tmp_path / "tiny.stl", 1e-3 * CUBE)
    surface_file(tmp_path / "open.stl", CUBE, FACES[1:])
    with pytest.raises(InputError, match=said):
        organ(tmp_path, zones, size=1.0)


def test_zones_that_no_body_has(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    surface_file(tmp_path / "left.stl")
    (tmp_path / "own.geo").write_text(SQUARE)
    mesh: dict[str, Any] = {"kind": "file", "path": "own.geo", "zones": {"left": "left.stl"}}
    with pytest.raises(InputError, match=r"key 'mesh\.zones\.left': the body is plane"):
        MeshFile(**mesh).found_from(tmp_path).raw_mesh()
    (tmp_path / "own.geo").write_text(
        'SetFactory("OpenCASCADE"); Box(1) = {0, 0, 0, 1, 1, 1}; Physical Volume("left") = {1};\n'
    )
    with pytest.raises(InputError, match="the mesh has a group of this name already"):
        MeshFile(**mesh).found_from(tmp_path).raw_mesh()
    change = "mesh.zones={left: left.vtu}"
    assert "'zones.left' = 'left.vtu': expected a closed surface, .stl, .obj, .ply" in refusal(
        ["body", "liver3d", "--set", change, "--out", str(tmp_path / "out")], capsys
    )
    assert not (tmp_path / "out").exists()
