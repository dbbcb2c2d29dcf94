"""Worked example of a user's own mesh: a plate with holes, from the mesh to the evaluation."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import yaml

from surrogate.learning.runs.config_reader import read_recipe
from tests.end_to_end.commands import DATAGEN, MPIRUN, SURROGATE, execute


@pytest.mark.slow
@pytest.mark.mpi
def test_plate_with_holes(tmp_path: Path) -> None:
    """After a short training, a prediction differs from the solution by less than 15 %."""
    config, _ = read_recipe("plate2d-det-fast")
    config["network"] |= {"channels": 12}
    config["training"] |= {"epochs": 30}
    (tmp_path / "short.yaml").write_text(yaml.safe_dump(config))
    nodal, grid, run = tmp_path / "nodal", tmp_path / "grid", tmp_path / "run"
    execute(*MPIRUN, DATAGEN, "run", "plate2d", "--samples", "550", "--out", nodal)
    said = execute(DATAGEN, "structure", nodal, "--out", grid).stdout
    assert "embedded on the mesh" in said
    for dataset in (nodal, grid):
        execute(DATAGEN, "check", dataset)
    execute(SURROGATE, "train", tmp_path / "short.yaml", "--data", grid, "--out", run)
    execute(SURROGATE, "evaluate", run, "--data", grid)
    test = json.loads((run / "evaluation.json").read_text())
    assert test["embedding_error"] < 0.01 * 0.1
    execute(SURROGATE, "report", run, "--nodal", nodal, "--out", tmp_path / "report.html")

    load = ("--load", "4,0:0.5,-2")
    execute(DATAGEN, "solve", "plate2d", *load, "--out", tmp_path / "fem.npz")
    execute(SURROGATE, "predict", run, *load, "--out", tmp_path / "net.npz")
    with np.load(tmp_path / "fem.npz") as fem, np.load(tmp_path / "net.npz") as net:
        assert np.array_equal(fem["coordinates"], net["coordinates"])
        difference = np.linalg.norm(fem["displacement"] - net["displacement"])
        assert difference < 0.15 * np.linalg.norm(fem["displacement"])
