"""Meshes of the fuzz: a right plate has area 4 m², a wrong one is not it."""

from __future__ import annotations

from pathlib import Path
from random import Random

import numpy as np
import pytest

from tools.fuzz.instability import mirror
from tools.fuzz.meshes import BROKEN, plate, write_plate


def test_a_plate_has_its_area() -> None:
    x, cells = plate(5, 3)
    sides = x[cells][:, 1:, :2] - x[cells][:, :1, :2]
    area = np.linalg.det(sides) / 2
    assert (area > 0).all()
    assert area.sum() == pytest.approx(4.0)


@pytest.mark.parametrize("kind", BROKEN)
def test_a_kind_changes_the_file_alike_each_time(kind: str, tmp_path: Path) -> None:
    texts = []
    for name in (kind, kind, "as it is"):
        write_plate(tmp_path / "a.vtk", Random(3), name)
        texts.append((tmp_path / "a.vtk").read_text())
    assert texts[0] == texts[1]
    assert (texts[0] == texts[2]) == (kind == "as it is")


def test_mirrored_nodes_of_the_beam() -> None:
    x = np.array([[0.0, 0.0], [0.0, 1.0], [4.0, 0.25], [4.0, 0.75]])
    assert mirror(x).tolist() == [1, 0, 3, 2]
