"""Every platform finds the same displacements, in all shipped cases, with both volumetric terms.

The reference is committed, see `reference_displacements`. Newton's method ends at residuals below
1e-8 N (1e-10 N by multigrid), in practice far below; other versions of the libraries round and
converge in other ways, which changes displacements by less than 1e-9 m.
"""

from __future__ import annotations

import json

import numpy as np
import pytest

from datagen.cases.case import read_case
from shared_schema.materials import VOLUMETRIC_TERMS, Volumetric
from tests.datagen.reference_displacements import (
    CASES,
    FILE,
    body_of,
    kept_nodes,
    samples_of,
    solved,
)

REFERENCE = json.loads(FILE.read_text())
SLOW = {"beam3d", "finger3d"}


@pytest.mark.parametrize("volumetric", VOLUMETRIC_TERMS)
@pytest.mark.parametrize(
    "name", [pytest.param(c, marks=pytest.mark.slow) if c in SLOW else c for c in CASES]
)
def test_displacements_are_those_of_every_platform(name: str, volumetric: Volumetric) -> None:
    case = read_case(name, volumetric=volumetric)
    body = body_of(case)
    samples = samples_of(case, body.problem.dimension)
    assert len(samples) >= 2
    for sample in samples:
        kept = REFERENCE[f"{name} {volumetric} {sample}"]
        load, u = solved(case, body, sample)
        assert load["nodes"] == kept["load"]["nodes"]
        assert np.asarray(load["forces"]) == pytest.approx(
            np.asarray(kept["load"]["forces"]), abs=1e-15
        )
        assert load.get("pressures", []) == pytest.approx(kept["load"].get("pressures", []))
        assert np.abs(u).max() > 1e-3
        assert np.abs(u[kept_nodes(len(u))] - kept["displacement"]).max() < 1e-9
        assert abs(np.sqrt(np.mean(u**2)) - kept["root_mean_square"]) < 1e-9
    body.problem.close()
