"""Calibrations of the shipped networks, and records of bounds."""

from __future__ import annotations

import pytest

import surrogate
from experiments.benchmarks.benchmark import stored_record
from surrogate.learning.runs.shelf import shelved


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
