from __future__ import annotations

import numpy as np
import pytest

from surrogate.studies import force_sweep_beam, force_sweep_lshape
from surrogate.studies.force_sweeps import (
    captured_outside,
    confident_inside,
    deviates_outside,
    matches_inside,
)
from surrogate.studies.study import Study
from surrogate.studies.workshop import Workshop
from tests.surrogate.force_sweeps import hand_made

FORCE = np.arange(-4.0, 5.0)


@pytest.mark.parametrize(("error", "matches"), [(0.09, True), (0.11, False)])
def test_matches_up_to_5_percent(error: float, matches: bool) -> None:
    """Of 2 m within ±2 N."""
    claim = matches_inside(hand_made(mean=FORCE + error * (FORCE == 1)))
    assert claim.holds == matches
    assert f"{error / 2:.2%}" in claim.evidence


@pytest.mark.parametrize(("error", "verdict"), [(0.19, "better"), (0.21, "reproduced")])
def test_deviates_above_5_percent(error: float, verdict: str) -> None:
    """Of 4 m up to ±4 N."""
    claim = deviates_outside("It", hand_made(mean=FORCE + error * (FORCE == 3)))
    assert claim.verdict == verdict


@pytest.mark.parametrize(
    ("inside", "at_4", "holds"), [(1.0, 16.0, True), (5.0, 16.0, False), (1.0, 8.0, False)]
)
def test_confident_inside(inside: float, at_4: float, holds: bool) -> None:
    """σ is 9 mm at 3 N: at least twice that inside, and it must grow up to 4 N."""
    std = np.array([16, 9, *[inside] * 5, 9, at_4]) * 1e-3
    assert confident_inside(hand_made(std_epistemic=std), (3, 4)).holds == holds


def test_captures_the_error_outside() -> None:
    """At 3 N, σ = 9 mm and 1.959964 σ = 17.6 mm: one of four forces outside."""
    assert captured_outside(hand_made(mean=FORCE + 0.017 * (FORCE == 3))).holds
    claim = captured_outside(hand_made(mean=FORCE + 0.018 * (FORCE == 3)))
    assert not claim.holds
    assert "75%" in claim.evidence


@pytest.mark.parametrize("study", [force_sweep_beam.STUDY, force_sweep_lshape.STUDY])
def test_table(workshop: Workshop, study: Study) -> None:
    """The made-up corner under vertical forces: the errors of the means over ±f."""
    outcome = study.conduct(workshop)
    (table,) = outcome.tables
    force, _, error, std, deterministic, inside = (float(cell or 0) for cell in table.rows[-1])
    body = study.name.removeprefix("force-sweep-")
    run = {"beam": "beam2d", "lshape": "lshape2d"}[body]
    vb, d = (workshop.predicted_loads(f"{run}-{kind}", f"{run}_sweep") for kind in ("vb", "det"))
    vertical = vb.samples.force[:, vb.node, 1]
    nearest = [np.abs(vertical - f).argmin() for f in (-force, force)]
    for loads, found in ((vb, error), (d, deterministic)):
        errors = np.abs(loads.predicted.mean - loads.samples.displacement)[nearest, vb.node, 1]
        assert found == pytest.approx(1e3 * errors.mean())
    assert std == pytest.approx(1e3 * vb.predicted.std[nearest, vb.node, 1].mean())
    assert inside == pytest.approx(vb.inside[nearest].mean())
    assert len(outcome.claims) == {"beam": 5, "lshape": 4}[body]
