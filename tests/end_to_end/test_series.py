"""From a case file to predictions without a sample, beside equilibria of the finite elements."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import torch
import yaml

import surrogate
from surrogate.mechanics.statics.load import checked_pressure
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


@pytest.mark.slow
def test_muscle_under_pressure(tmp_path: Path) -> None:
    """The beam of Land et al. (2015), problem 1: z between 4.14 and 4.20 mm, by five terms alone.

    Fibres, an exponential energy, elements with a dilation of their own, and a pressure of 4 Pa
    that follows the surface; without a pressure that is given, the forces tell it.
    """
    muscle = {"model": "guccione", "stiffness": 2000, "b_f": 8, "b_t": 2, "b_fs": 4}
    case = {
        "name": "muscle",
        "mesh": {
            "kind": "box",
            "lower": [0, 0, 0],
            "upper": [0.01, 0.001, 0.001],
            "elements": [40, 4, 4],
        },
        "material": {**muscle, "bulk_modulus": 1.0e6, "fibres": [1, 0, 0]},
        "element": "incompressible",
        "supports": [{"x": 0}],
        "load": {"family": "pressure", "region": {"z": 0}, "range": [1, 4]},
        "dataset": {"samples": 1, "seed": 1},
    }
    (tmp_path / "case.yaml").write_text(yaml.safe_dump(case))
    execute(DATAGEN, "body", tmp_path / "case.yaml", "--out", tmp_path / "body")
    execute(SURROGATE, "train", "series", "--data", tmp_path / "body", "--out", tmp_path / "run")
    model = surrogate.load(tmp_path / "run")
    x = model.geometry.coordinates
    pushed = checked_pressure(model.geometry, [4.0], np.zeros_like(x))
    assert pushed is not None
    load = pushed.load[0] * model.geometry.free
    found = model.predict(load, pressure=[4.0])
    end = np.isclose(x, [0.01, 0.0005, 0.001]).all(axis=1)
    ((_, y, z),) = 1e3 * (x + found)[end]
    assert y == pytest.approx(0.5, abs=1e-6)
    assert 4.14 < z < 4.20
    np.testing.assert_allclose(model.predict(load), found, atol=1e-9)
    of_tensor = model.predict(torch.from_numpy(load / 4), pressure=[1.0])
    np.testing.assert_array_equal(of_tensor.numpy(), model.predict(load / 4, pressure=[1.0]))
