"""Axial forces on the beam: both programs find the same stable states, up to mirror images."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import surrogate
from tests.end_to_end.commands import DATAGEN, execute

CRITICAL = 8.783  # N, of these elements; π² E I / (4 L²) = 7.65 N in plane strain


@pytest.mark.slow
@pytest.mark.parametrize("force", [-80.0, -20.0, -1.001 * CRITICAL, -0.999 * CRITICAL, 20.0])
def test_same_state_or_its_mirror_image(tmp_path: Path, force: float) -> None:
    """Four equal forces on the end; both residuals are 1e-8 N at most, so within 1e-4."""
    model = surrogate.load("beam2d_any")
    x = model.geometry.coordinates
    forces = np.zeros(x.shape)
    forces[x[:, 0] == 4, 0] = force / 4
    np.savez(tmp_path / "forces.npz", coordinates=x, force=forces)
    out = tmp_path / "solved.npz"
    given = tmp_path / "forces.npz"
    said = execute(DATAGEN, "solve", "beam2d_any", "--forces", given, "--out", out).stdout
    assert ("past an unstable equilibrium" in said) == (force < -CRITICAL)
    with np.load(out) as solved:
        theirs = solved["displacement"]
    ours = model.correct(forces).displacement
    mirror = [np.linalg.norm(x - [a, 1 - b], axis=1).argmin() for a, b in x]
    size = np.abs(theirs).max()
    differences = [np.abs(each - theirs).max() for each in (ours, ours[mirror] * [1, -1])]
    assert min(differences) < 1e-4 * size
    body, f = model.body.equilibrium, forces[None]
    assert body.potential(ours[None], f) == pytest.approx(body.potential(theirs[None], f), rel=1e-6)
    assert body.unstable_mode(theirs[None]) is None
