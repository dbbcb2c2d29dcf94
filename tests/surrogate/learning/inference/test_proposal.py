"""Proposed load cases: the worst first, and different from each other."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from shared_schema.load_cases import read_load_cases
from surrogate.command_line import main
from surrogate.learning.data.load_families import random_loads
from surrogate.learning.inference.loading import load
from surrogate.learning.inference.proposal import farthest, propose


def test_farthest_points() -> None:
    """(0, 9) is farthest from zero; (0, 8.9) is near it; (5, 0) is then 5 from zero."""
    points = np.array([[1, 0], [0, 8.9], [0, 9], [5, 0], [0, 3]], dtype=np.float32)
    assert farthest(points, 3).tolist() == [2, 3, 4]
    assert sorted(farthest(points, 5)) == [0, 1, 2, 3, 4]


def test_proposed_loads_are_predicted_worse(trained: Path) -> None:
    surrogate = load(trained)
    data = surrogate.description.data
    family = random_loads("trained", surrogate.geometry, data.info.force.max_abs, data.load_numbers)
    found = propose(surrogate, 10, among=200, seed=3)
    assert np.median(found.errors) > 1.5 * found.median
    estimated = surrogate.fast_estimate(found.forces, surrogate.predict(found.forces))
    np.testing.assert_allclose(found.errors, np.abs(estimated).mean(axis=(1, 2)), rtol=2e-3)
    length = np.linalg.norm(estimated.reshape(10, -1), axis=1)
    assert length.argmax() == 0
    drawn = family.draw(200, np.random.default_rng(3))
    assert all((drawn == force).all(axis=(1, 2)).any() for force in found.forces)


def test_command(trained: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "loads.h5"
    command = ["propose", str(trained), "--count", "4", "--family", "loads=2,reach=0.5"]
    assert main([*command, "--out", str(out)]) == 0
    assert f"{out}: 4 load cases of 80, estimated mean error" in capsys.readouterr().out
    cases, surrogate = read_load_cases(out), load(trained)
    np.testing.assert_array_equal(cases.coordinates, surrogate.geometry.coordinates)
    assert (cases.nodes >= 0).sum(axis=1).tolist() == [2] * 4
    limit = 0.5 * np.array(surrogate.description.data.info.force.max_abs)
    assert (np.abs(cases.forces) <= limit).all()


@pytest.mark.parametrize(
    ("options", "part"),
    [
        (("--family", "loads=0"), "--family 'loads=0': 'loads' = 0-0, expected"),
        (("--among", "3"), "--among 3: expected 4 at least"),
        (("--seed", "-1"), "seed = -1, expected 0 at least"),
    ],
)
def test_wrong_input(
    trained: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    options: tuple[str, ...],
    part: str,
) -> None:
    out = tmp_path / "loads.h5"
    assert main(["propose", str(trained), "--count", "4", "--out", str(out), *options]) == 2
    assert part in capsys.readouterr().err
    assert not out.exists()
