from __future__ import annotations

import numpy as np
import pytest

from surrogate.studies import timing
from surrogate.studies.constant_channels import PAPER, claims_on, conduct
from surrogate.studies.workshop import Workshop


def test_rows(workshop: Workshop, monkeypatch: pytest.MonkeyPatch) -> None:
    """Runs of 1 and 2 channels, of which the paper has none."""
    monkeypatch.setattr(timing, "SECONDS", 0.05)
    outcome = conduct(workshop)
    rows = outcome.tables[0].rows
    assert [row[0] for row in rows] == [1, 2]
    for channels, _, mean, std, *_ in rows:
        run = f"beam3d-c{channels}"
        test = workshop.dataset_of(run).nodal_test
        e = np.abs(workshop.predicted_test(run).mean - test.displacement).mean(axis=(1, 2))
        assert (mean, std) == pytest.approx((1e3 * e.mean(), 1e3 * e.std(ddof=1)))
    assert outcome.comparisons == []
    (claim,) = outcome.claims
    assert "c = 128 was not run" in claim.evidence


def test_claims_hold_of_the_papers_numbers() -> None:
    """Table "const_channel": 1.6, 1.1, 0.8, then 3.5 mm."""
    claims = claims_on({channels: paper.mean for channels, paper in PAPER.items()})
    assert [claim.verdict for claim in claims] == ["reproduced", "reproduced"]


def test_claims_do_not_hold_of_others() -> None:
    """Not falling from 32 to 64; still falling from 64 to 128, which is for the better."""
    claims = claims_on({16: 1.6, 32: 0.7, 64: 0.8, 128: 0.6})
    assert [claim.verdict for claim in claims] == ["differs", "better"]
