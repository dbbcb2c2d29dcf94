"""Networks that come with the package, against the finite elements."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.end_to_end.commands import DATAGEN, SURROGATE, execute

LOADS = {
    "beam2d_any": ("2.1333,0.3333:0.5,-1", "4,0:0,-1"),
    "lshape2d_any": ("4.8,1.4286:0.3,-0.5", "6,2:0,0.4"),
    "beam3d_any": ("4,1,1:0.3,-0.5,0.2", "2.6667,0,0.5455:-0.2,0.4,0.5"),
}


@pytest.mark.parametrize("name", LOADS)
def test_any_load(name: str, tmp_path: Path) -> None:
    """Two loads at once: every node within 0.5 % of the largest displacement."""
    loads = [word for load in LOADS[name] for word in ("--load", load)]
    execute(DATAGEN, "solve", name, *loads, "--out", tmp_path / "fem.npz")
    execute(SURROGATE, "predict", name, *loads, "--out", tmp_path / "net.npz")
    with np.load(tmp_path / "fem.npz") as fem, np.load(tmp_path / "net.npz") as net:
        np.testing.assert_allclose(fem["coordinates"], net["coordinates"], rtol=0, atol=1e-9)
        difference, reference = (
            np.linalg.norm(field, axis=1).max()
            for field in (fem["displacement"] - net["displacement"], fem["displacement"])
        )
    assert difference < 0.005 * reference
