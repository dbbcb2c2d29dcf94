from __future__ import annotations

import numpy as np

from experiments.paper.force_sweeps import (
    captured_outside,
    confident_inside,
    deviates_outside,
    matches_inside,
    sweep_table,
)
from tests.surrogate.force_sweeps import hand_made

FORCE = np.arange(-4.0, 5.0)


def test_deviates_across_the_force() -> None:
    """No error along it; ‖U − u‖₂ = 0.4 m of ‖u‖₂ = 5 m is 8 %."""
    sweep = hand_made(node_error=0.4 * (FORCE == 4), moved=1.25 * np.abs(FORCE))
    assert matches_inside(sweep).holds
    claim = deviates_outside("It", sweep)
    assert claim.holds
    assert "8 %" in claim.evidence


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
