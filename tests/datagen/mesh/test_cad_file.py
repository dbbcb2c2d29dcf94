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
