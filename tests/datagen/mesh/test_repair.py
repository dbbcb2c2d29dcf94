"""Surfaces that gmsh cannot fill, and what fTetWild makes of them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import datagen
from datagen.mesh.mesh_file import MeshFile
from shared_schema.common.errors import InputError
from tests.closed_surfaces import CUBE, FACES, surface_file
from tests.datagen.mesh.test_mesh_file import volume
from tests.datagen.refusal import refusal

pytest.importorskip("pytetwild")


def test_cubes_that_overlap_and_are_open(tmp_path: Path) -> None:
    """Two cubes of 1 m³ share 1/8 m³: together they have 1.875 m³, also without a triangle.

    The surface of 9.75 m² may move by 40 mm, and moves by less than 5 mm in the mean: 2.5 %.
    """
    corners = np.concatenate([CUBE, CUBE + 0.5])
    faces = np.concatenate([FACES, len(CUBE) + FACES])
    for triangles, said in ((faces, "cuts itself at"), (faces[:-1], "is not closed")):
        surface_file(tmp_path / "own.stl", corners, triangles)
        wanted = MeshFile(kind="file", path="own.stl").found_from(tmp_path)
        with pytest.raises(InputError, match=f"{said}.*; `datagen repair` makes one closed"):
            wanted.raw_mesh()
    count = datagen.repair(tmp_path / "own.stl", tmp_path / "one.ply", size=1.2)
    assert count > 24
    mesh = MeshFile(kind="file", path="one.ply").found_from(tmp_path).raw_mesh()
    assert volume(mesh) == pytest.approx(1.875, rel=0.025)


def test_what_cannot_be_repaired(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    surface_file(tmp_path / "flat.stl", CUBE, FACES[:2])
    (tmp_path / "text.stl").write_text("no solid")
    before = sorted(tmp_path.iterdir())
    for name, out, size, said in (
        ("text.stl", "out.stl", "1", "text.stl: "),
        ("none.stl", "out.stl", "1", "no such file"),
        ("flat.stl", "out.vtu", "1", "out.vtu"),
        ("flat.stl", "out.stl", "-1", "size -1: expected more than 0"),
    ):
        words = ["repair", str(tmp_path / name), "--out", str(tmp_path / out), "--size", size]
        assert said in refusal(words, capsys)
    assert sorted(tmp_path.iterdir()) == before
