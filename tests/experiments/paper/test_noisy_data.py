from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from experiments.framework.experiment import Findings
from experiments.framework.resources import Resources
from experiments.paper.noisy_data import (
    captured,
    noise_ratio,
    refined,
    unreliable,
)
from surrogate.learning.data.samples import NodalSamples
from surrogate.learning.measures.force_sweep import ForceSweep
from tests.surrogate.force_sweeps import hand_made

FORCE = np.arange(-80, 81) * 0.05
STD = np.where(np.abs(FORCE) < 0.72, 0.2 / np.sqrt(3) * np.abs(FORCE), 0.0)  # of u = f


def fine(**changes: Any) -> ForceSweep:
    """u = f in steps of 0.05 N, trained up to 1 N; σ as the noise, and outside growing as |f|."""
    std = np.where(np.abs(FORCE) > 1.02, np.abs(FORCE), STD)
    fields: dict[str, Any] = {
        "limit": 1.0,
        "force": FORCE,
        "reference": FORCE,
        "mean": FORCE,
        "std_epistemic": 0 * FORCE,
        "std_aleatoric": std,
        "covered_components": np.ones_like(FORCE),
    }
    return hand_made(**fields | changes)


@pytest.mark.parametrize(
    ("factor", "holds"), [(0.4, False), (0.6, True), (1.9, True), (2.1, False)]
)
def test_noise_is_captured_within_a_factor_of_2(factor: float, holds: bool) -> None:
    sweep = fine(std_aleatoric=factor * STD)
    assert noise_ratio(sweep) == pytest.approx(factor)
    assert captured("It", {"a": fine(), "b": sweep}).holds == holds


def test_unreliable_where_wrong() -> None:
    """Errors of 1 m with σ = |f| are inside the band, with σ = 0.1 m outside."""
    wrong = fine(mean=FORCE + 1)
    sure = fine(mean=FORCE + 1, std_aleatoric=np.full_like(FORCE, 0.1))
    assert unreliable({"a": sure}).verdict == "reproduced"
    claim = unreliable({"a": sure, "b": wrong})
    assert claim.verdict == "better"
    assert "a 0 %, b 100 % (not reliable: < 50 %)" in claim.evidence


def test_networks(resources: Resources, result_of: Callable[[str], Findings]) -> None:
    """Rows by likelihood, panels by body; errors at 4 N are those of the refined sweep."""
    result = result_of("noisy-data")
    beam, lshape = "2D beam", "2D L-shape"
    rows = {str(row[0]): row for row in result.tables[0].rows}
    assert list(rows) == [f"{beam} (MLE)", f"{lshape} (MLE)", f"{beam} (VB)", f"{lshape} (VB)"]
    figure, _ = result.figures["std"]
    titles = [axes.get_title() for axes in figure.axes]
    assert titles == [f"{beam} (MLE)", f"{beam} (VB)", f"{lshape} (MLE)", f"{lshape} (VB)"]
    samples = refined(resources.nodal("lshape2d_sweep").samples)
    ends = NodalSamples(samples.force[[0, -1]], samples.displacement[[0, -1]])
    predicted = resources.surrogate("lshape2d_noisy-mle").predict(ends.force)
    errors = np.abs(predicted - ends.displacement)[ends.force != 0]
    assert rows[f"{lshape} (MLE)"][-1] == pytest.approx(1e3 * errors.mean())
