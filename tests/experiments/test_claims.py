"""Loads that mislead estimates are what they are said to be; broken claims are counted."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import surrogate
from experiments.benchmarks import claims
from experiments.benchmarks.benchmark import stored_record
from experiments.benchmarks.suspect_loads import KINDS, SuspectLoads, critical_factor
from surrogate.mechanics import Equilibrium
from surrogate.mechanics.descent import Descent
from surrogate.mechanics.statics.body import Body
from tests.surrogate.mechanics.bodies import MATERIAL
from tests.surrogate.mechanics.descent.test_claims import grid


def test_critical_factor_is_that_of_euler() -> None:
    """π² E' I / 4 L², with what layers of bilinear cells are too stiff in bending.

    Of n layers, 1/n² of the bending is within the cells, which of length a and height b take
    [1/(1 - ν') + (a/b)²/2] / (1 + ν') times the work of a beam (Cook, Malkus, Plesha and Witt,
    *Concepts and Applications of Finite Element Analysis*, 2002, Section 3.6); E' = E/(1 - ν²)
    and ν' = ν/(1 - ν) in plane strain.
    """
    length, height, layers = 10.0, 0.5, 3
    body = Equilibrium(grid((length, height), (40, layers)), MATERIAL)
    force = np.zeros((len(body.free), 2))
    end = np.flatnonzero(body.geometry.coordinates[:, 0] == length)
    force[end, 0] = -1 / len(end)
    nu = MATERIAL.poisson_ratio / (1 - MATERIAL.poisson_ratio)
    modulus = MATERIAL.young_modulus / (1 - MATERIAL.poisson_ratio**2)
    euler = np.pi**2 * modulus * height**3 / 12 / (4 * length**2)
    slenderness = (length / 40) / (height / layers)
    locked = (1 / (1 - nu) + slenderness**2 / 2) / (1 + nu)
    expected = euler * (1 + (locked - 1) / layers**2)
    assert critical_factor(body, force) == pytest.approx(expected, rel=0.02)
    assert critical_factor(body, -force) > 100 * expected  # a column that is pulled


def test_loads_are_drawn_again() -> None:
    """All kinds, on free nodes, ten times as large where they are said to be."""
    model = surrogate.load("beam2d_any")
    one, other = SuspectLoads(model), SuspectLoads(model)
    drawn = {kind: one.draw(kind, np.random.default_rng(3)) for kind in KINDS}
    for kind, force in drawn.items():
        assert force.any()
        assert not force[model.geometry.held].any()
        np.testing.assert_array_equal(other.draw(kind, np.random.default_rng(3)), force)
    np.testing.assert_array_equal(drawn["times 10"], 10 * drawn["usual"])
    assert np.count_nonzero(drawn["single"].any(axis=1)) == 1


def test_claims_are_judged_and_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One load of each kind; then the same ones with displacements that are 1 % too large."""
    kept = tmp_path / "rows.jsonl"
    found = claims.of_network("beam2d_any", len(KINDS), 1, kept)
    assert found["loads"] == found["claims"] + found["unstable"] + found["undecided"] == len(KINDS)
    assert found["claims"] >= 5
    assert (found["broken"], found["worst"] <= claims.TOLERANCE) == (0, True)
    lines = kept.read_text()
    assert [json.loads(line)["kind"] for line in lines.splitlines()] == list(KINDS)
    assert claims.of_network("beam2d_any", len(KINDS), 1, kept) == found
    assert kept.read_text() == lines
    descend = Body.descend

    def exaggerated(*given: Any) -> tuple[np.ndarray, Descent]:
        u, descent = descend(*given)
        return 1.01 * u, replace(descent, reached=True, stable=True)

    monkeypatch.setattr(Body, "descend", exaggerated)
    wrong = claims.of_network("beam2d_any", len(KINDS), 1, None)
    assert wrong["claims"] == wrong["broken"] == len(KINDS)
    assert wrong["worst"] >= 0.0099  # 1 - 1/1.01
    page = claims.page(
        {"seed": 1, "loads": 9, "claims": 9, "broken": 9, "bodies": 1, "networks": [wrong]}
    )
    assert "**Of 9 claims 9 are broken.**" in page
    assert "| `beam2d_any` | linear, quad | neo hookean | 9 | 9 | 0 | 0 | 0.9" in page
    assert "snap-through 1 of 1." in page


def test_no_claim_of_the_record_is_broken() -> None:
    """20 000 and more, on all bodies of `suspects`, of all materials and elements."""
    numbers = stored_record("claims").findings.numbers
    assert numbers["claims"] >= 20_000
    assert numbers["broken"] == 0
    names = {of["name"] for of in numbers["networks"]}
    assert {path.stem for path in claims.SUSPECTS.glob("*.yaml")} < names
    assert {of["material"] for of in numbers["networks"]} == {
        "neo_hookean",
        "st_venant_kirchhoff",
        "mooney_rivlin",
        "yeoh",
        "gent",
    }
    elements = {of["elements"].split(",")[0] for of in numbers["networks"]}
    assert elements == {"linear", "quadratic", "incompressible"}
