"""Two ranks that share a solve find what one rank finds, with every element and linear solver."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import meshio
import numpy as np
import pytest
import yaml

from shared_schema.shard import read_shard
from tests.datagen.farm_runs import datagen, execute, finish
from tests.datagen.solver.cantilever import box


@pytest.mark.mpi
@pytest.mark.slow
@pytest.mark.parametrize(
    ("element", "simplices", "linear_solver"),
    [
        ("linear", False, "lu"),
        ("linear", True, "corotated"),
        ("quadratic", False, "corotated"),
        ("quadratic", True, "lu"),
        ("incompressible", False, "corotated"),
        ("incompressible", True, "lu"),
        ("incompressible", True, "corotated"),
    ],
)
def test_same_displacements(
    tmp_path: Path, element: str, simplices: bool, linear_solver: str
) -> None:
    """Residuals end at 1e-12 of loads of about 1 N, so displacements are equal to 1e-9 m."""
    raw = box((4.0, 1.0), (12, 4), simplices)
    meshio.write_points_cells(tmp_path / "beam.vtu", raw.coordinates, {raw.cell_type: raw.cells})
    content: dict[str, Any] = {
        "name": "beam",
        "mesh": {"kind": "file", "path": "beam.vtu"},
        "material": {"young_modulus": 500, "poisson_ratio": 0.45},
        "element": element,
        "supports": [{"x": 0}],
        "load": {"family": "random_node", "region": {"x": 4}, "range": [-1, 1]},
        "solver": {"relative_tolerance": 1e-12, "linear_solver": linear_solver},
        "dataset": {"samples": 2, "seed": 1, "test_fraction": 0.5},
    }
    case = tmp_path / "case.yaml"
    case.write_text(yaml.safe_dump(content))
    found = []
    for ranks in (1, 2):
        out = tmp_path / str(ranks)
        result = execute(ranks, case, out, "--ranks-per-solve", str(ranks))
        assert result.returncode == 0, result.stderr
        found.append(read_shard(out / "shard-00000.h5", "nodal")["samples/displacement"])
    assert np.abs(found[0] - found[1]).max() < 1e-9
    assert np.abs(found[0]).max() > 0.05


@pytest.mark.mpi
@pytest.mark.slow
@pytest.mark.parametrize(("element", "simplices"), [("quadratic", False), ("incompressible", True)])
def test_distributed_loads_on_points_between(tmp_path: Path, element: str, simplices: bool) -> None:
    """A pressure that follows and a body force: displacements, and forces between the nodes."""
    raw = box((4.0, 1.0), (6, 2), simplices)
    meshio.write_points_cells(tmp_path / "beam.vtu", raw.coordinates, {raw.cell_type: raw.cells})
    content: dict[str, Any] = {
        "name": "beam",
        "mesh": {"kind": "file", "path": "beam.vtu"},
        "material": {"young_modulus": 500, "poisson_ratio": 0.45},
        "element": element,
        "supports": [{"x": 0}],
        "load": [
            {"family": "pressure", "region": {"y": 1}, "range": [1, 2]},
            {"family": "body_force", "range": [-1, 1]},
        ],
        "solver": {"relative_tolerance": 1e-12, "linear_solver": "lu"},
        "dataset": {"samples": 2, "seed": 1, "test_fraction": 0.5},
    }
    case = tmp_path / "case.yaml"
    case.write_text(yaml.safe_dump(content))
    found = []
    for ranks in (1, 2):
        out = tmp_path / str(ranks)
        result = execute(ranks, case, out, "--ranks-per-solve", str(ranks))
        assert result.returncode == 0, result.stderr
        found.append(read_shard(out / "shard-00000.h5", "nodal"))
    for name in ("samples/displacement", "samples/force", "samples/force_between"):
        one, two = (arrays[name] for arrays in found)
        assert np.abs(one - two).max() < 1e-9 * np.abs(one).max(), name
    assert np.abs(found[0]["samples/displacement"]).max() > 0.05


@pytest.mark.mpi
@pytest.mark.slow
@pytest.mark.parametrize(
    "words",
    [
        ["plate2d", "--load", "4,0.8:0,-2", "--nearest"],
        ["finger3d", "--load", "notches:900", "--load", "0.088,0.01,0.008:0.1,0,0.1", "--nearest"],
    ],
    ids=["plate2d", "finger3d"],
)
def test_one_load_case(tmp_path: Path, words: list[str]) -> None:
    """Every field of `datagen solve`; one rank writes it, and says so once."""
    fields = []
    for ranks in (0, 2):
        out = tmp_path / f"{ranks}.npz"
        result = finish(datagen("solve", *words, "--stresses", "--out", out, ranks=ranks))
        assert result.returncode == 0, result.stderr
        assert result.stdout.count("largest displacement") == 1
        with np.load(out) as arrays:
            fields.append(dict(arrays))
    for name, expected in fields[0].items():
        if expected.dtype.kind == "f":
            difference = np.abs(fields[1][name] - expected).max()
            assert difference <= 1e-9 * np.abs(expected).max(), name
