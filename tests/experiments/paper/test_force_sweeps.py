from __future__ import annotations

import numpy as np
import pytest

from experiments.framework.experiment import Experiment
from experiments.framework.resources import Resources
from experiments.paper.force_sweeps import (
    BEAM,
    LSHAPE,
    captured_outside,
    confident_inside,
    deviates_outside,
    ends,
    matches_inside,
    sweep_table,
)
from tests.surrogate.force_sweeps import hand_made

FORCE = np.arange(-4.0, 5.0)


def test_ends() -> None:
    """Trained up to 2 N, of which 4 N is twice and the largest; then twice 1 N, and 4 N."""
    assert ends(hand_made()) == [0, 2, 6, 8]
    assert ends(hand_made(limit=1.0)) == [0, 2, 3, 5, 6, 8]


@pytest.mark.parametrize(("error", "matches"), [(0.09, True), (0.11, False)])
def test_matches_up_to_5_percent(error: float, matches: bool) -> None:
    """The displacements are 2 m within ±2 N."""
    claim = matches_inside(hand_made(mean=FORCE + error * (FORCE == 1)))
    assert claim.holds == matches
    assert f"{50 * error:g} %" in claim.evidence


@pytest.mark.parametrize(("error", "verdict"), [(0.19, "better"), (0.21, "reproduced")])
def test_deviates_above_5_percent(error: float, verdict: str) -> None:
    """The displacements are 4 m up to ±4 N."""
    claim = deviates_outside("It", hand_made(mean=FORCE + error * (FORCE == 3)))
    assert claim.verdict == verdict


def test_deviates_across_the_force() -> None:
    """No error along it; ‖U − u‖₂ = 0.4 m of ‖u‖₂ = 5 m is 8 %."""
    sweep = hand_made(node_error=0.4 * (FORCE == 4), moved=1.25 * np.abs(FORCE))
    assert matches_inside(sweep).holds
    claim = deviates_outside("It", sweep)
    assert claim.holds
    assert "8 %" in claim.evidence


@pytest.mark.parametrize(
    ("inside", "at_4", "holds"), [(1.0, 16.0, True), (9.0, 16.0, False), (1.0, 8.0, False)]
)
def test_confident_inside(inside: float, at_4: float, holds: bool) -> None:
    """At least twice the 1 or 9 mm inside at ±4 N, and growing from the 9 mm at ±3 N."""
    std = np.array([16, 9, *[inside] * 5, 9, at_4]) * 1e-3
    assert confident_inside(hand_made(std_epistemic=std)).holds == holds


def test_confident_in_both_senses() -> None:
    """At −4 N σ is 1.8 mm, less than twice the 1 mm inside; the mean of both senses is not."""
    std = np.array([1.8, 1.5, 1, 1, 1, 1, 1, 9, 16]) * 1e-3
    claim = confident_inside(hand_made(std_epistemic=std))
    assert not claim.holds
    assert "at -4 N 1.8, at 4 N 16.0" in claim.evidence


def test_captures_the_error_outside() -> None:
    """At 3 N, σ = 9 mm and 1.959964 σ = 17.6 mm: one of the two positive forces outside."""
    assert captured_outside(hand_made(mean=FORCE + 0.017 * (FORCE == 3))).holds
    sweep = hand_made(
        mean=FORCE + 0.018 * (FORCE == 3), covered_across=FORCE > 0, covered_components=FORCE / 10
    )
    claim = captured_outside(sweep)
    said = "100 % of the negative forces outside, 50 % of the positive"
    assert not claim.holds
    assert said in claim.evidence
    assert said in confident_inside(sweep).evidence
    assert "across it, at 0 % of the negative forces outside, 100 %" in claim.evidence


def test_rows_by_signed_force() -> None:
    """σ in mm is f² outside, 1 inside; the deterministic error is 0.2 m everywhere."""
    vb = hand_made(
        mean=FORCE - 0.3 * (FORCE == 4),
        moved=2 * np.abs(FORCE),
        node_error=0.5 * (FORCE == 4),
        covered_components=np.linspace(0, 1, 9),
    )
    table = sweep_table(vb, hand_made(mean=FORCE + 0.2))
    np.testing.assert_allclose(
        np.array(table.rows, dtype=float),
        [
            [-4, 8, 200, 0, 0, 16, 0],
            [-2, 4, 200, 0, 0, 1, 25],
            [2, 4, 200, 0, 0, 1, 75],
            [4, 8, 200, 500, 300, 16, 100],
        ],
    )


@pytest.mark.parametrize("study", [BEAM, LSHAPE])
def test_last_row(resources: Resources, study: Experiment[Resources]) -> None:
    """The made-up corner under vertical forces, the largest of them upwards."""
    result = study.measure(resources)
    body = study.name.removeprefix("force-sweep-")
    run = {"beam": "beam2d", "lshape": "lshape2d"}[body]
    vb, d = (resources.predicted_loads(f"{run}-{kind}", f"{run}_sweep") for kind in ("vb", "det"))
    number = vb.samples.force[:, vb.node, 1].argmax()
    u = vb.samples.displacement[number, vb.node]
    errors = [loads.predicted.mean[number, vb.node] - u for loads in (d, vb)]
    expected = [
        8,
        np.linalg.norm(u),
        *(1e3 * np.linalg.norm(error) for error in errors),
        1e3 * abs(errors[1][1]),
        1e3 * vb.predicted.std[number, vb.node, 1],
        100 * vb.inside[number],
    ]
    assert result.tables[0].rows[-1] == pytest.approx(expected)
    assert len(result.claims) == {"beam": 5, "lshape": 4}[body]
