"""Loads of all kinds over ranks that share a solve, and between the nodes of quadratic elements."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import yaml
from mpi4py import MPI

from datagen import info, run, structure
from datagen.cases.body import make_body
from datagen.cases.case import Case, read_case
from datagen.solver.load_stepping import solve_load_case
from shared_schema.checker import check_dataset
from shared_schema.common.bodies.nodal_forces import scatter_forces
from shared_schema.common.errors import InputError
from shared_schema.common.files import sha256
from shared_schema.dataset_reader import DatasetReader
from shared_schema.manifest import read_manifest, write_manifest
from tests.datagen.farm_runs import execute

HALVES = """
SetFactory("OpenCASCADE");
Rectangle(1) = {0, 0, 0, 1, 1};
Rectangle(2) = {1, 0, 0, 1, 1};
Coherence;
Physical Surface("soft") = {1};
Physical Surface("stiff") = {2};
Mesh.MeshSizeMax = 0.25;
"""
CASE = {
    "name": "halves",
    "mesh": {"kind": "file", "path": "halves.geo"},
    "material": [
        {"group": "soft", "model": "mooney_rivlin", "c10": 60, "c01": 25, "bulk_modulus": 3000},
        {"group": "stiff", "young_modulus": 900, "poisson_ratio": 0.3},
    ],
    "supports": [{"x": 0, "components": ["x"]}, {"x": 0, "y": 0}],
    "load": [
        {"family": "displacement", "region": {"x": 2}, "range": [0.05, 0.3]},
        {"family": "pressure", "region": {"y": 1}, "range": [1, 20]},
        {"family": "body_force", "region": {}, "range": [-20, 20]},
    ],
    "dataset": {"samples": 4, "seed": 5, "shard_size": 2},
}
TRACTION = {"family": "traction", "region": {"x": 2}, "range": [20, 60]}
GRIP = {"family": "displacement", "region": {"x": 2}, "range": [0.1, 0.2]}


@pytest.mark.slow
@pytest.mark.mpi
def test_ranks_that_share_a_solve_find_the_same(tmp_path: Path) -> None:
    (tmp_path / "halves.geo").write_text(HALVES)
    case = tmp_path / "case.yaml"
    case.write_text(yaml.safe_dump(CASE))
    names = ("samples/displacement", "samples/force", "samples/pressure")
    run(case, tmp_path / "alone", comm=MPI.COMM_SELF)
    result = execute(2, case, tmp_path / "shared", "--ranks-per-solve", "2")
    assert result.returncode == 0, result.stderr
    assert check_dataset(tmp_path / "shared") == []
    alone, shared = (DatasetReader(tmp_path / name).joined(names) for name in ("alone", "shared"))
    for name in names:
        scale = np.abs(alone[name]).max()
        np.testing.assert_allclose(shared[name], alone[name], atol=1e-9 * scale, err_msg=name)
    assert np.abs(alone["samples/displacement"]).max() > 0.05


def case_of(folder: Path, load: Any, samples: int = 2, **changes: Any) -> Case:
    content = {
        "name": "quadratic",
        "mesh": {"kind": "box", "lower": [0, 0], "upper": [2, 1], "elements": [2, 1]},
        "material": {"young_modulus": 1000, "poisson_ratio": 0.3},
        "element": "quadratic",
        "supports": [{"x": 0}],
        "load": load,
        "dataset": {"samples": samples, "seed": 1},
    }
    path = folder / f"case{samples}.yaml"
    path.write_text(yaml.safe_dump(content | changes))
    return read_case(path)


@pytest.mark.parametrize(
    "load", [TRACTION, GRIP, TRACTION | {"region": {"y": 1}, "family": "pressure"}]
)
def test_recorded_forces_give_the_same_equilibrium(load: dict[str, Any], tmp_path: Path) -> None:
    """As dead loads; those of a pressure, at rest, give that of the pressure to first order."""
    small = load["family"] == "pressure"
    load = load | {"range": [1e-4, 2e-4]} if small else load
    case = case_of(tmp_path, load)
    manifest = run(case, tmp_path / "nodal", comm=MPI.COMM_SELF)
    assert manifest.forces == "consistent"
    assert check_dataset(tmp_path / "nodal") == []
    names = ["samples/loaded_nodes", "samples/force", "samples/force_between"]
    reader = DatasetReader(tmp_path / "nodal")
    nodes, force, between, u = reader.joined([*names, "samples/displacement"]).values()
    assert between.shape == (2, 9, 2)
    assert between.any(axis=(1, 2)).all()
    point = {"family": "random_node", "region": {"x": 2}, "range": [-1, 1]}
    free = make_body(case_of(tmp_path, point, 3), MPI.COMM_SELF)
    for number in range(2):
        dead = nodes[number], force[number]
        if (dead[0] < 0).any():  # padded
            dead = np.arange(6), scatter_forces(nodes[number], force[number], 6)
        report = solve_load_case(free.problem, *dead, case.solver, between=between[number])
        assert report.solved
        difference = np.abs(free.problem.displacement() - u[number]).max()
        assert difference < (1e-5 if small else 1e-8) * np.abs(u).max()
    structure(tmp_path / "nodal", tmp_path / "grid")
    assert check_dataset(tmp_path / "grid") == []
    kept = DatasetReader(tmp_path / "grid").joined(["samples/force_between"])
    np.testing.assert_array_equal(kept["samples/force_between"], between)
    assert info(tmp_path / "grid")["distributed loads on"] == "all points of the elements"


def test_point_forces_have_nothing_between(tmp_path: Path) -> None:
    load = {"family": "random_node", "region": {"x": 2}, "range": [-1, 1]}
    run(case_of(tmp_path, load), tmp_path / "nodal", comm=MPI.COMM_SELF)
    (_, arrays), *_ = DatasetReader(tmp_path / "nodal")
    assert "samples/force_between" not in arrays


def test_dataset_of_an_earlier_version(tmp_path: Path) -> None:
    """It says where its loads act, and does not grow by others; it stays as it is."""
    out = tmp_path / "nodal"
    run(case_of(tmp_path, TRACTION), out, comm=MPI.COMM_SELF)
    manifest = read_manifest(out)
    (entry,) = manifest.shards
    with h5py.File(out / entry.file, "a") as file:
        for group in ("samples", "failed"):
            del file[f"{group}/force_between"]
    shard = entry.model_copy(update={"sha256": sha256(out / entry.file)})
    write_manifest(out, manifest.model_copy(update={"forces": None, "shards": (shard,)}))
    assert check_dataset(out) == []
    before = {path.name: sha256(path) for path in out.iterdir()}
    said = info(out)["distributed loads on"]
    assert said == "the corners of the cells alone, as in datasets of earlier versions"
    with pytest.raises(InputError, match="made by an earlier version, whose distributed loads act"):
        run(case_of(tmp_path, TRACTION, samples=4), out, comm=MPI.COMM_SELF)
    assert {path.name: sha256(path) for path in out.iterdir()} == before
    assert run(case_of(tmp_path, TRACTION), out, comm=MPI.COMM_SELF).forces is None


@pytest.mark.mpi
def test_more_ranks_than_cells(tmp_path: Path) -> None:
    case_of(tmp_path, TRACTION)
    words = ("--ranks-per-solve", "3")
    result = execute(3, tmp_path / "case2.yaml", tmp_path / "nodal", *words)
    assert result.returncode == 2
    assert "3 ranks share its 2 cells and one of them gets none" in result.stderr
    assert "Traceback" not in result.stderr
    assert not (tmp_path / "nodal").exists()
