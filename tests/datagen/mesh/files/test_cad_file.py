"""CAD files: made by gmsh's OpenCASCADE in millimetres, meshed in metres."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import gmsh
import numpy as np
import pytest
import yaml

from datagen import solve
from datagen.cases.case import read_case
from datagen.mesh.mesh_file import MeshFile
from shared_schema.common.errors import InputError
from tests.datagen.mesh.test_mesh_file import CASE, volume
from tests.datagen.refusal import refusal

BLOCKS = """SetFactory("OpenCASCADE");
Box(1) = {0, 0, 0, 40, 10, 10}; Cylinder(2) = {20, 5, -1, 0, 0, 12, 3};
BooleanDifference{ Volume{1}; Delete; }{ Volume{2}; Delete; }
Box(3) = {40, 0, 0, 10, 10, 10};
"""
PLATE = """SetFactory("OpenCASCADE"); Rectangle(1) = {0, 0, 0, 40, 10};
"""


def made(folder: Path, name: str, script: str) -> Path:
    """Write a CAD file of a gmsh script."""
    (folder / "own.geo").write_text(script)
    gmsh.initialize()
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.open(str(folder / "own.geo"))
        gmsh.write(str(folder / name))
    finally:
        gmsh.finalize()
    return folder / name


def case_of(folder: Path, mesh: dict[str, Any]) -> Path:
    path = folder / "own.yaml"
    place = {"supports": [{"x": 0}], "load": {"family": "body_force", "range": [-1, 1]}}
    path.write_text(yaml.safe_dump(CASE | place | {"mesh": {"kind": "file", **mesh}}))
    return path


def iges(path: Path, faces: list[list[list[float]]], unit: str) -> None:
    """Write plane faces as B-spline surfaces (entities 128), four corners each, row by row."""
    of_unit = {"mm": "2,2HMM", "inch": "1,4HINCH"}[unit]
    head = f"1H,,1H;,1Hp,1Hf,1Hs,1Hv,32,38,6,308,15,1Hp,1.,{of_unit},1,0.01,"
    head += "15H20200101.000000,1.E-06,1000.,1Ha,1Ho,11,0,15H20200101.000000;"
    lines = [head[i : i + 72] for i in range(0, len(head), 72)]
    text = f"{'faces':72}S{1:7}\n"
    text += "".join(f"{line:72}G{n:7}\n" for n, line in enumerate(lines, 1))
    directory, parameters, count = "", "", 0
    for number, corners in enumerate(faces):
        entry = 2 * number + 1
        knots = ["0.", "0.", "1.", "1."] * 2 + ["1."] * 4
        values = [*map(str, [128, 1, 1, 1, 1, 0, 0, 1, 0, 0]), *knots]
        values += [f"{x:.4f}" for corner in corners for x in corner] + ["0.", "1.", "0.", "1."]
        rows = [",".join(values[i : i + 8]) for i in range(0, len(values), 8)]
        ended = [row + "," for row in rows[:-1]] + [rows[-1] + ";"]
        zeros = f"{0:8}" * 6
        directory += f"{128:8}{count + 1:8}{zeros}{'00000000':8}D{entry:7}\n"
        directory += f"{128:8}{0:8}{0:8}{len(rows):8}{0:8}{'':24}{0:8}D{entry + 1:7}\n"
        for row in ended:
            count += 1
            parameters += f"{row:64}{entry:8}P{count:7}\n"
    text += directory + parameters
    path.write_text(f"{text}S{1:7}G{len(lines):7}D{2 * len(faces):7}P{count:7}{'':40}T{1:7}\n")


def block_faces(lengths: tuple[float, float, float]) -> list[list[list[float]]]:
    """Six faces of a box with a corner at the origin."""
    faces = []
    for axis in range(3):
        one, two = (k for k in range(3) if k != axis)
        for side in (0.0, lengths[axis]):
            corners = np.zeros((4, 3))
            corners[:, axis] = side
            corners[[1, 3], one], corners[[2, 3], two] = lengths[one], lengths[two]
            faces.append(corners.tolist())
    return faces


@pytest.mark.parametrize(
    ("name", "unit", "metres"), [("own.iges", "mm", 1e-3), ("own.IGS", "inch", 0.0254)]
)
def test_iges(name: str, unit: str, metres: float, tmp_path: Path) -> None:
    """Six faces of 4 × 1 × 1 units are sewn to a body; one in the plane z = 0 is a plate."""
    iges(tmp_path / name, block_faces((4, 1, 1)), unit)
    geometry = MeshFile(kind="file", path=name, size=0.6 * metres).found_from(tmp_path)
    mesh = geometry.raw_mesh()
    assert mesh.cell_type == "tetra"
    assert volume(mesh) == pytest.approx(4 * metres**3, rel=1e-6)
    assert mesh.coordinates.max(axis=0) == pytest.approx(np.array([4, 1, 1]) * metres)
    iges(tmp_path / name, block_faces((4, 1, 1))[4:5], unit)
    plate = geometry.model_copy(update={"sha256": None}).found_from(tmp_path).raw_mesh()
    assert plate.cell_type == "triangle"
    assert volume(plate) == pytest.approx(4 * metres**2, rel=1e-6)
    iges(tmp_path / name, block_faces((4, 1, 1))[:5], unit)
    with pytest.raises(InputError, match="5 faces that bound no body, expected closed ones"):
        geometry.model_copy(update={"sha256": None}).found_from(tmp_path).raw_mesh()


@pytest.mark.parametrize("suffix", ["step", "STP", "brep"])
def test_two_blocks_and_a_hole(suffix: str, tmp_path: Path) -> None:
    """50 × 10 × 10 mm less a hole of 3 mm: 5000 − 90 π = 4717 mm³; BREP has no unit.

    The hole is a polygon on the mesh, so the volume is some thousandths larger.
    """
    path = made(tmp_path, f"own.{suffix.lower()}", BLOCKS).rename(tmp_path / f"own.{suffix}")
    unit = 1.0 if suffix == "brep" else 1e-3
    mesh = MeshFile(kind="file", path=path.name, size=3 * unit).found_from(tmp_path).raw_mesh()
    assert mesh.cell_type == "tetra"
    assert np.ptp(mesh.coordinates, axis=0) == pytest.approx(np.array([50, 10, 10]) * unit)
    assert volume(mesh) == pytest.approx((5000 - 90 * np.pi) * unit**3, rel=0.02)
    between = mesh.coordinates[np.isclose(mesh.coordinates[:, 0], 40 * unit)]
    assert len(between) == len(np.unique(between.round(9), axis=0))


def test_a_plate_is_solved(tmp_path: Path) -> None:
    made(tmp_path, "own.step", PLATE)
    case = read_case(case_of(tmp_path, {"path": "own.step", "size": 0.002}))
    solution = solve(case, body_force=(0, -1000))
    assert solution.cell_type == "triangle"
    assert np.ptp(solution.coordinates, axis=0) == pytest.approx([0.04, 0.01])
    assert solution.reactions.sum(axis=0) == pytest.approx(-solution.force.sum(axis=0), abs=1e-8)


@pytest.mark.parametrize(
    ("mesh", "said"),
    [
        ({"path": "own.step"}, "'size' of 'own.step': expected that of the cells in m"),
        (
            {"path": "own.geo", "size": 1},
            "'size' of 'own.geo': expected none, it is no CAD",
        ),
        ({"path": "own.step", "size": 0.1}, "key 'mesh.path' = 'own.step': "),
        ({"path": "own.step", "size": -1}, "size' = -1: input should be greater"),
    ],
)
def test_wrong_cad_files(
    mesh: dict[str, Any], said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "own.step").write_text("ISO-10303-21;\nnonsense\n")
    (tmp_path / "own.geo").write_text(PLATE)
    path, out = case_of(tmp_path, mesh), str(tmp_path / "out.npz")
    assert said in refusal(["solve", str(path), "--body-force", "0,-1", "--out", out], capsys)
    with pytest.raises(InputError):
        solve(str(path), body_force=(0, -1))
