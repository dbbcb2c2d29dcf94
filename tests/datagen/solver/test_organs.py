"""The breast of the paper's authors against their solution by AceFEM."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import datagen
from shared_schema import DatasetReader

ROOT = Path(__file__).parents[3]
ACEFEM = ROOT / "experiments/organs/breast_acefem.txt"  # u in m, saurabhdeshpande93/MAgNET, MIT
BODY_FORCE = (-5941.76154725, -5233.60075768, -2561.67423583)  # N/m³, fitted to that solution


def test_breast_under_a_body_force() -> None:
    """Equal to AceFEM's solution to 1e-9 of the largest displacement, 0.0656 m."""
    published = np.loadtxt(ACEFEM)
    solution = datagen.solve("breast3d", body_force=BODY_FORCE)
    assert np.abs(published).max() == pytest.approx(0.0487, abs=1e-4)
    error = np.abs(solution.displacement - published).max()
    assert error <= 1e-9 * np.linalg.norm(published, axis=1).max()


@pytest.mark.parametrize(
    ("name", "nodes", "clamped"), [("breast3d", 1035, 224), ("liver3d", 3057, 168)]
)
def test_bodies(name: str, nodes: int, clamped: int, tmp_path: Path) -> None:
    """Nodes and supports are as many as the authors published."""
    datagen.body(name, tmp_path / name)
    reader = DatasetReader(tmp_path / name, "structured")
    assert len(reader.body["mesh/coordinates"]) == nodes
    assert reader.body["mesh/clamped"].sum() == clamped
