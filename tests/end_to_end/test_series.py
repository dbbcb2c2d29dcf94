"""From a case file to predictions without a sample, beside equilibria of the finite elements."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from tests.end_to_end.commands import DATAGEN, SURROGATE, execute


def test_body_is_predicted_without_a_sample(tmp_path: Path) -> None:
    """The paper's beam: in the mean of all loads 0.1 % of the largest displacement at most."""
    body, run, nodal, grid = (tmp_path / name for name in ("body", "run", "nodal", "grid"))
    execute(DATAGEN, "body", "beam2d", "--out", body)
    execute(SURROGATE, "train", "series", "--data", body, "--out", run)
    execute(DATAGEN, "run", "beam2d", "--samples", "20", "--out", nodal)
    execute(DATAGEN, "structure", nodal, "--out", grid)
    execute(SURROGATE, "evaluate", run, "--data", grid)
    test = json.loads((run / "evaluation.json").read_text())["test"]
    assert test["relative_error_mean"] < 1e-3

    load = ("--load", "4,1:0.5,-1.5")
    execute(DATAGEN, "solve", "beam2d", *load, "--out", tmp_path / "fem.npz")
    files = "--certify", "--correct", "--out", tmp_path / "series.npz"
    execute(SURROGATE, "predict", run, *load, *files)
    with np.load(tmp_path / "fem.npz") as fem, np.load(tmp_path / "series.npz") as series:
        assert np.array_equal(fem["coordinates"], series["coordinates"])
        assert np.allclose(fem["displacement"], series["displacement"], rtol=0, atol=1e-8)
