"""Calibrations of the shipped networks."""

from __future__ import annotations

import pytest

import surrogate
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
