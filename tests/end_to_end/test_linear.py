"""A linear surrogate, without dolfinx, uses the tangent stiffness that dolfinx assembles."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import yaml

from shared_schema.stiffness import STIFFNESS_FILE
from surrogate.learning.runs.config_reader import read_recipe
from tests.end_to_end.commands import DATAGEN, ROOT, SURROGATE, execute


@pytest.mark.slow
def test_tiny_loads_are_linear_elasticity(tmp_path: Path) -> None:
    """After minimal training, nonlinear equilibria under ±1e-4 N are predicted to 1e-4."""
    case = yaml.safe_load((ROOT / "datagen" / "configs" / "beam2d.yaml").read_text())
    case["load"]["range"] = [-1e-4, 1e-4]
    case["solver"] = {"tolerance": 1e-10}
    case["dataset"] |= {"samples": 40}
    (tmp_path / "tiny.yaml").write_text(yaml.safe_dump(case))
    config, _ = read_recipe("beam2d-linear-fast")
    config["training"] = {"epochs": 1, "optimiser": {"learning_rate": 1e-12}}
    (tmp_path / "linear.yaml").write_text(yaml.safe_dump(config))
    nodal, grid, run = tmp_path / "nodal", tmp_path / "grid", tmp_path / "run"
    execute(DATAGEN, "run", tmp_path / "tiny.yaml", "--out", nodal)
    execute(DATAGEN, "structure", nodal, "--out", grid)
    assert (grid / STIFFNESS_FILE).is_file()
    execute(DATAGEN, "check", grid)
    execute(SURROGATE, "train", tmp_path / "linear.yaml", "--data", grid, "--out", run)
    execute(SURROGATE, "evaluate", run, "--data", grid)
    evaluation = json.loads((run / "evaluation.json").read_text())
    assert evaluation["trainable_parameters"] == 120**2
    assert evaluation["test"]["relative_tip_error_mean"] < 1e-4

    load = ("--load", "4,1:1e-4,-1e-4")
    execute(DATAGEN, "solve", tmp_path / "tiny.yaml", *load, "--out", tmp_path / "fem.npz")
    execute(SURROGATE, "predict", run, *load, "--out", tmp_path / "net.npz")
    with np.load(tmp_path / "fem.npz") as fem, np.load(tmp_path / "net.npz") as net:
        difference = np.linalg.norm(fem["displacement"] - net["displacement"])
        assert difference < 1e-4 * np.linalg.norm(fem["displacement"])
