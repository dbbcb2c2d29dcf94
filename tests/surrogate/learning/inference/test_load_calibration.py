"""Fast bounds are calibrated on random loads of a case, without a dataset."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

import surrogate
from shared_schema.common.errors import InputError
from surrogate.command_line import main
from surrogate.learning.inference.calibration import drawn_loads
from surrogate.learning.runs.shelf import SHELF
from surrogate.mechanics.statics.load import Load


@pytest.fixture(scope="module")
def finger() -> surrogate.Surrogate:
    return surrogate.load("finger3d")


def test_loads_of_a_case_with_pressure(finger: surrogate.Surrogate) -> None:
    """One node has a force of up to 0.15 N a component, the notches have up to 1500 Pa."""
    forces = drawn_loads(finger, 30, np.random.default_rng(3))
    load = Load.of_samples(finger.geometry, forces)
    dead, pressure = load.dead, load.following
    assert pressure is not None
    assert (np.count_nonzero(dead.any(axis=2), axis=1) == 1).all()
    assert 0.1 < np.abs(dead).max() <= 0.15
    assert 0 <= pressure.amplitudes.min() < 500
    assert 1000 < pressure.amplitudes.max() <= 1500


def test_loads_of_other_cases_are_refused(
    finger: surrogate.Surrogate, monkeypatch: pytest.MonkeyPatch
) -> None:
    load = {"family": "body_force", "range": [0, 1]}
    monkeypatch.setitem(finger.description.data.case, "load", load)
    with pytest.raises(InputError, match="load family 'body_force', range 0 to 1: expected random"):
        drawn_loads(finger, 1, np.random.default_rng(0))


def test_calibration_of_a_run(tmp_path: Path) -> None:
    """Ratios of corrected loads are stored, and bounds of others hold; both are sealed."""
    run = tmp_path / "beam"
    shutil.copytree(SHELF / "beam2d_any", run)
    assert main(["calibrate", str(run), "--loads", "60", "--fresh", "30", "--seed", "3"]) == 0
    model = surrogate.load(run)
    ratios = model.fast_certificate.ratios
    content = model.run.read_evaluation()
    assert content["test"] == surrogate.load("beam2d_any").run.read_evaluation()["test"]
    found = content["fast_certificate"]
    assert found["samples"] == len(ratios["mean"]) == len(ratios["largest"]) >= 55
    assert found["calibration"].startswith("60 random loads, family trained, seed 3, ")
    bounded = found["bounded"]
    assert bounded["loads"] == 30
    assert 20 <= bounded["bounded"] == round(30 * (1 - found["refused"])) <= 30
    assert max(bounded["exceeded"].values()) <= 6
