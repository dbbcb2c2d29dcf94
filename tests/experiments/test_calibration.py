"""Fast bounds are calibrated on corrected loads of a case; those of the shipped networks are."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

import surrogate
from experiments.__main__ import main
from experiments.benchmarks.benchmark import stored_record
from experiments.calibration_commands import random_loads_of_case
from shared_schema.common.errors import InputError
from surrogate.inference.given_load import separated
from surrogate.runs.shelf import SHELF, shelved


@pytest.fixture(scope="module")
def finger() -> surrogate.Surrogate:
    return surrogate.load("finger3d")


def test_loads_of_a_case_with_pressure(finger: surrogate.Surrogate) -> None:
    """One node has a force of up to 0.15 N a component, the notches have up to 1500 Pa."""
    forces = random_loads_of_case(finger, 30, 3)
    dead, pressure = separated(finger.geometry, forces)
    assert pressure is not None
    assert (np.count_nonzero(dead.any(axis=2), axis=1) == 1).all()
    assert 0.1 < np.abs(dead).max() <= 0.15
    assert 0 <= pressure.pressures.min() < 500
    assert 1000 < pressure.pressures.max() <= 1500
    np.testing.assert_array_equal(random_loads_of_case(finger, 5, 3), forces[:5])


def test_loads_of_other_cases_are_refused(
    finger: surrogate.Surrogate, monkeypatch: pytest.MonkeyPatch
) -> None:
    load = {"family": "body_force", "range": [0, 1]}
    monkeypatch.setitem(finger.description.data.case, "load", load)
    with pytest.raises(InputError, match="load family 'body_force', range 0 to 1: expected random"):
        random_loads_of_case(finger, 1, 0)


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
    assert found["calibration"].startswith("60 loads of the case, seed 3, ")
    bounded = found["bounded"]
    assert bounded["loads"] == 30
    assert 20 <= bounded["bounded"] == round(30 * (1 - found["refused"])) <= 30
    assert max(bounded["exceeded"].values()) <= 6


@pytest.mark.parametrize("name", shelved())
def test_calibration_of_the_shipped_networks(name: str) -> None:
    """The evaluation counts the ratios that are stored, and measures bounds that hold."""
    model = surrogate.load(name)
    fast, found = model.fast_certificate, model.run.read_evaluation()["fast_certificate"]
    assert found["samples"] == len(fast.ratios["mean"]) == len(fast.ratios["largest"]) >= 100
    assert fast.calibrated is not None
    for entry in found["mean"] + found["largest"]:
        assert entry["coverage"] >= entry["level"] - 0.06
    for measure in ("mean", "largest"):
        assert fast.factor(0.95, measure) >= fast.factor(0.9, measure) >= 1


@pytest.mark.parametrize("name", ["bounded-loads", "bounded-loads-space"])
def test_bounds_of_unusual_loads_held(name: str) -> None:
    """No more than 1 % of the bounds of probability 0.95 were exceeded, under eight kinds."""
    networks = stored_record(name).findings.numbers["networks"]
    kinds = [kind for network in networks.values() for kind in network.values()]
    assert len(kinds) == 8 * len(networks) == 16
    bounded = sum(kind["bounded"] for kind in kinds)
    assert bounded >= 100
    for measure in ("mean", "largest"):
        assert sum(kind["exceeded"][measure] for kind in kinds) <= 0.01 * bounded
