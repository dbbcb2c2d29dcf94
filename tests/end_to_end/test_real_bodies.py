"""A rubber body with a chamber: sliding supports, pressure and forces, from mesh to prediction."""

from __future__ import annotations

import json
from pathlib import Path

import meshio
import numpy as np
import pytest
import yaml

import surrogate
from shared_schema.common.bodies.command_loads import command_loads
from tests.end_to_end.commands import DATAGEN, SURROGATE, execute

BELLOWS = """
SetFactory("OpenCASCADE");
Rectangle(1) = {0, 0, 0, 2, 1};
Disk(2) = {1.2, 0.5, 0, 0.3};
BooleanDifference(10) = { Surface{1}; Delete; }{ Surface{2}; Delete; };
Physical Surface("gel") = {10};
Physical Curve("chamber") = Curve In BoundingBox{0.85, 0.15, -1, 1.55, 0.85, 1};
Physical Curve("end") = Curve In BoundingBox{1.99, -0.01, -1, 2.01, 1.01, 1};
Physical Curve("root") = Curve In BoundingBox{-0.01, -0.01, -1, 0.01, 1.01, 1};
Mesh.MeshSizeMax = 0.15;
"""
CASE = {
    "name": "bellows",
    "mesh": {"kind": "file", "path": "bellows.geo"},
    "material": {"model": "gent", "shear_modulus": 1000, "limit": 30, "bulk_modulus": 20000},
    "supports": [{"group": "root", "components": ["x"]}, {"x": 0, "y": 0}],
    "load": [
        {"family": "pressure", "region": {"group": "chamber"}, "range": [0, 300]},
        {"family": "random_nodes", "region": {"group": "end"}, "range": [-20, 20], "count": [1, 2]},
    ],
    "dataset": {"samples": 40, "seed": 5, "shard_size": 20, "test_fraction": 0.2},
}
CONFIG = {
    "name": "bellows",
    "case": "bellows",
    "likelihood": "deterministic",
    "network": {
        "channels": 8,
        "levels": 2,
        "inputs": ["force", "linear_gradient"],
        "skip": "linear",
    },
    "training": {"epochs": 3, "batch_size": 8, "validation_fraction": 0.1},
}


@pytest.mark.slow
def test_from_mesh_to_prediction(tmp_path: Path) -> None:
    """Stresses and reactions of both programs are the same; with the load the reactions balance."""
    (tmp_path / "bellows.geo").write_text(BELLOWS)
    case, config = tmp_path / "case.yaml", tmp_path / "config.yaml"
    case.write_text(yaml.safe_dump(CASE))
    config.write_text(yaml.safe_dump(CONFIG))
    nodal, structured, run = (tmp_path / name for name in ("nodal", "structured", "run"))
    execute(DATAGEN, "run", case, "--out", nodal)
    execute(DATAGEN, "structure", nodal, "--out", structured)
    for folder in (nodal, structured):
        execute(DATAGEN, "check", folder)
    execute(SURROGATE, "train", config, "--data", structured, "--out", run)
    execute(SURROGATE, "evaluate", run, "--data", structured)
    evaluation = json.loads((run / "evaluation.json").read_text())
    assert 0 < evaluation["von_mises"]["relative_error"] < 1
    assert (run / "figures" / "von_mises.png").is_file()

    loads = ["--load", "chamber:250", "--load", "end:0,-10"]
    solved, predicted = tmp_path / "solved.npz", tmp_path / "predicted.npz"
    execute(DATAGEN, "solve", case, *loads, "--stresses", "--out", solved)
    execute(SURROGATE, "predict", run, *loads, "--stresses", "--out", predicted)
    model = surrogate.load(run)
    with np.load(solved) as theirs, np.load(predicted) as ours:
        assert sorted(theirs) == sorted(ours)
        np.testing.assert_allclose(ours["force"], theirs["force"], atol=1e-12)
        u = theirs["displacement"]
        for name, values in model.stresses(u).items():
            scale = np.abs(theirs[name]).max()
            np.testing.assert_allclose(values, theirs[name], atol=1e-11 * scale, err_msg=name)
        given = command_loads(model.geometry.loaded_body, loads[1::2])
        reactions = model.reactions(u, given.pushed(u))
        np.testing.assert_allclose(reactions, theirs["reaction"], atol=1e-9)
        balance = reactions + given.pushed(u) + given.forces
        np.testing.assert_allclose(balance.sum(axis=0), 0, atol=1e-8)
        assert not u[model.geometry.held].any()

        # The correction is the factory's equilibrium, and the certificate knows the error before.
        corrected = tmp_path / "corrected.npz"
        options = ("--certify", "--out", str(corrected))
        execute(SURROGATE, "predict", run, *loads, *options)
        with np.load(corrected) as certified:
            wrong = certified["displacement"] - u
            scale = np.abs(wrong).max()
            np.testing.assert_allclose(certified["estimated_error"], wrong, atol=0.02 * scale)
        execute(SURROGATE, "predict", run, *loads, "--correct", *options)
        with np.load(corrected) as found:
            np.testing.assert_allclose(found["displacement"], u, atol=1e-6 * np.abs(u).max())

    out = tmp_path / "none.npz"
    said = execute(SURROGATE, "predict", run, "--load", "hole:250", "--out", out, code=2).stderr
    assert "mesh has chamber, end, gel, root" in said
    assert not out.exists()

    execute(DATAGEN, "export", nodal, "--out", tmp_path / "e.pvd", "--samples", "0:2", "--stresses")
    first = meshio.read(tmp_path / "e" / "sample-00000.vtu")
    assert first.cell_data["cauchy"][0].shape == (len(first.cells[0]), 9)
    held = np.isclose(first.points[:, 0], 0)
    assert np.abs(first.point_data["reaction"][held]).max() > 1
    assert not first.point_data["reaction"][~held].any()
