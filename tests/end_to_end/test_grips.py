"""Held places: the learner finds the reactions of the factory's prescribed displacements."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.end_to_end.commands import DATAGEN, SURROGATE, execute


@pytest.mark.parametrize(
    ("options", "within"), [([], 1e-3), (["--correct"], 1e-6)], ids=["predicted", "corrected"]
)
def test_grips_on_the_beam(tmp_path: Path, options: list[str], within: float) -> None:
    """One corner is moved, another one slides; a force acts beside them."""
    given = [
        "--body-force",
        "0,-0.3",
        "--hold",
        "4,1:0.06,-0.7",
        "--hold",
        "4,0:-,-0.65",
        "--load",
        "1.86667,1:0.5,-1",
    ]
    execute(DATAGEN, "solve", "beam2d", *given, "--out", tmp_path / "truth.npz")
    out = tmp_path / "held.npz"
    execute(SURROGATE, "predict", "beam2d_any", *given, *options, "--out", out)
    with np.load(tmp_path / "truth.npz") as truth, np.load(out) as found:
        for name in ("displacement", "force"):
            largest = np.abs(truth[name]).max()
            np.testing.assert_allclose(found[name], truth[name], atol=within * largest)
