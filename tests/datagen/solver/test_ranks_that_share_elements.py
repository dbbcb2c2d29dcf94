"""Two ranks that share a solve find what one rank finds, with every element and linear solver."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import meshio
import numpy as np
import pytest
import yaml
from mpi4py import MPI

import datagen
from datagen.command_line import main
from shared_schema.layout import Arrays
from shared_schema.shard import read_shard
from tests.datagen import farm_runs
from tests.datagen.solver.cantilever import box

pytestmark = [pytest.mark.mpi, pytest.mark.slow]
POINT = {"family": "random_node", "region": {"x": 4}, "range": [-1, 1]}
SPREAD = [
    {"family": "pressure", "region": {"y": 1}, "range": [1, 2]},
    {"family": "body_force", "range": [-1, 1]},
]


def both(
    folder: Path, element: str, simplices: bool, linear_solver: str, load: Any
) -> list[Arrays]:
    """Two samples of a beam, by one rank and by two that share a solve."""
    raw = box((4.0, 1.0), (12, 4), simplices)
    meshio.write_points_cells(folder / "beam.vtu", raw.coordinates, {raw.cell_type: raw.cells})
    content: dict[str, Any] = {
        "name": "beam",
        "mesh": {"kind": "file", "path": "beam.vtu"},
        "material": {"young_modulus": 500, "poisson_ratio": 0.45},
        "element": element,
        "supports": [{"x": 0}],
        "load": load,
        "solver": {"relative_tolerance": 1e-12, "linear_solver": linear_solver},
        "dataset": {"samples": 2, "seed": 1, "test_fraction": 0.5},
    }
    case = folder / "case.yaml"
    case.write_text(yaml.safe_dump(content))
    datagen.run(case, folder / "one", comm=MPI.COMM_SELF)
    result = farm_runs.execute(2, case, folder / "two", "--ranks-per-solve", "2")
    assert result.returncode == 0, result.stderr
    return [read_shard(folder / name / "shard-00000.h5", "nodal") for name in ("one", "two")]


@pytest.mark.parametrize(
    ("element", "simplices", "linear_solver", "load"),
    [
        ("linear", True, "corotated", POINT),
        ("quadratic", False, "corotated", [POINT, *SPREAD]),
        ("incompressible", False, "lu", POINT),
        ("incompressible", True, "lu", [POINT, *SPREAD]),
        ("incompressible", True, "corotated", POINT),
    ],
)
def test_same_samples(
    tmp_path: Path, element: str, simplices: bool, linear_solver: str, load: Any
) -> None:
    """Residuals end at 1e-12 of loads of about 1 N, so displacements are equal to 1e-9 m.

    A pressure that follows and a body force have forces between the nodes as well.
    """
    found = both(tmp_path, element, simplices, linear_solver, load)
    for name in ("displacement", "force", *(["force_between"] if load is not POINT else [])):
        one, two = (arrays[f"samples/{name}"] for arrays in found)
        assert np.abs(one - two).max() < 1e-9 * max(1.0, np.abs(one).max()), name
    assert np.abs(found[0]["samples/displacement"]).max() > 0.05


@pytest.mark.parametrize(
    "words",
    [
        ["plate2d", "--load", "4,0.8:0,-2", "--nearest"],
        ["beam3d", "--set", "mesh.elements=[12, 4, 4]", "--load", "4,0.5,1:0,0.5,1"],
    ],
    ids=["plate2d", "beam3d"],
)
def test_one_load_case(tmp_path: Path, words: list[str]) -> None:
    """Every field of `datagen solve`; one rank writes it, and says so once."""
    one, two = tmp_path / "one.npz", tmp_path / "two.npz"
    assert main(["solve", *words, "--stresses", "--out", str(one)]) == 0
    done = farm_runs.finish(farm_runs.datagen("solve", *words, "--stresses", "--out", two, ranks=2))
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("largest displacement") == 1
    with np.load(one) as expected, np.load(two) as found:
        for name in expected:
            if expected[name].dtype.kind == "f":
                difference = np.abs(found[name] - expected[name]).max()
                assert difference <= 1e-9 * np.abs(expected[name]).max(), name
