"""Motion: two programs take the same time steps."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.end_to_end.commands import DATAGEN, SURROGATE, execute

CASE = """
name: swing
mesh: {kind: box, lower: [0, 0], upper: [4, 1], elements: [8, 2]}
material: {young_modulus: 500, poisson_ratio: 0.3, density: 1.0}
supports: [{x: 0}]
load: {family: random_node, region: {y: 1, x: "> 0"}, range: [-1, 1]}
time: {step: 0.02, duration: 0.6, damping: {mass: 0.1, stiffness: 0.005}}
dataset: {samples: 4, seed: 1, test_fraction: 0.25}
"""


@pytest.mark.parametrize("history", ["let_go", "ramp=0.3"])
def test_one_trajectory(tmp_path: Path, history: str) -> None:
    """Of a damped beam: to 10⁻⁸ by tight steps, and to 10⁻³ within the tolerance of the learner."""
    case, body, truth = (tmp_path / name for name in ("swing.yaml", "body", "truth.npz"))
    case.write_text(CASE)
    execute(DATAGEN, "body", case, "--out", body)
    given = ["--load", "4,1:0,-1", "--duration", "0.6", "--history", history]
    execute(DATAGEN, "solve", case, *given, "--out", truth)
    expected = np.load(truth)["displacement"][1:]
    for tolerance, within in (("1e-9", 1e-8), ("5e-3", 1e-3)):
        out = tmp_path / "found.npz"
        steps = "--step", "0.02", "--tolerance", tolerance, "--out", out
        execute(SURROGATE, "simulate", body, *given, *steps)
        found = np.load(out)["displacement"]
        np.testing.assert_allclose(found, expected, atol=within * np.abs(expected).max())
