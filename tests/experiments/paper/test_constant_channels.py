from __future__ import annotations

import json
from collections.abc import Callable

import numpy as np
import pytest

from experiments.framework.experiment import Findings
from experiments.framework.resources import Resources
from experiments.framework.scale import Scale, merged, read_scale
from experiments.paper.catalogue import REPRODUCTION
from experiments.paper.constant_channels import (
    PAPER_NETWORKS,
    PAPER_STANDARD,
    claims_on,
    standard_run,
)


def test_rows(resources: Resources, result_of: Callable[[str], Findings]) -> None:
    """Runs of 1 and 2 channels, of which the paper has none; losses of their last epochs."""
    result = result_of("constant-channels")
    rows = result.tables[0].rows
    assert [row[0] for row in rows] == [1, 2]
    for channels, _, mean, std, _, _, training, validation in rows:
        run = f"beam3d-c{channels}"
        test = resources.dataset_of(run).nodal_test
        e = np.abs(resources.predicted_test(run).mean - test.displacement).mean(axis=(1, 2))
        assert (mean, std) == pytest.approx((1e3 * e.mean(), 1e3 * e.std(ddof=1)))
        last = json.loads(resources.run(run).metrics.read_text().splitlines()[-1])
        assert (training, validation) == (last["train_loss"], last["validation_loss"])
    assert result.comparisons == []
    (claim,) = result.claims
    assert claim.what.endswith("up to c = 2.")
    assert "not run here: c = 16, c = 32, c = 64, c = 128, the standard U-Net" in claim.evidence


def test_claims_hold_of_the_papers_numbers() -> None:
    """Table "const_channel": 1.6, 1.1, 0.8, then 3.5 mm; 348 of 1060 min."""
    claims = claims_on(PAPER_NETWORKS, PAPER_STANDARD)
    assert [claim.verdict for claim in claims] == 3 * ["reproduced"]
    assert "not run" not in claims[0].evidence


def test_standard_network() -> None:
    """The standard U-Net of scale `paper` is trained as long as c = 64; `laptop` has none."""

    def found(scale: Scale) -> str | None:
        runs = {int(run[8:]): run for run in scale.matching(("beam3d-c*",))}
        return standard_run(scale, runs)

    paper = read_scale("paper", REPRODUCTION.scales)
    assert found(paper) == "beam3d-det"
    assert found(read_scale("laptop", REPRODUCTION.scales)) is None
    shorter = {"runs": {"beam3d-det": {"change": {"training": {"epochs": 74}}}}}
    assert found(Scale.model_validate(merged(paper.model_dump(), shorter))) is None
