"""Rigid tools: the learner finds the forces of the factory's contact."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.end_to_end.commands import DATAGEN, SURROGATE, execute

POSES = {
    "disc": ["--tool", "sphere:3,1.2:0.3", "--body-force", "0,0.1"],
    "column": ["--tool", "sphere:4.05,0.5:0.3"],  # beyond the load of Euler: the contact holds it
    "floor": ["--tool", "plane:4,-0.4:0.1,1", "--load", "1.86667,1:0.5,-3"],
}


@pytest.mark.parametrize("pose", POSES)
@pytest.mark.parametrize(
    ("options", "within"), [([], 1e-3), (["--correct"], 1e-6)], ids=["predicted", "corrected"]
)
def test_tools_on_the_beam(tmp_path: Path, pose: str, options: list[str], within: float) -> None:
    execute(DATAGEN, "solve", "beam2d", *POSES[pose], "--out", tmp_path / "truth.npz")
    out = tmp_path / "pushed.npz"
    execute(SURROGATE, "predict", "beam2d_any", *POSES[pose], *options, "--out", out)
    with np.load(tmp_path / "truth.npz") as truth, np.load(out) as found:
        for name in ("displacement", "force"):
            largest = np.abs(truth[name]).max()
            np.testing.assert_allclose(found[name], truth[name], atol=within * largest)
