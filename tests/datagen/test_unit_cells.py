"""Unit cells that dolfinx solves: closed form without holes, seeds, PLAID's files."""

from __future__ import annotations

import subprocess
from pathlib import Path

import numpy as np
import pytest

from experiments.unit_cells import generate
from experiments.unit_cells.unit_cell import read_cells, write_cell
from tests.datagen.plaid_format.conftest import plaid as plaid

READER = Path(generate.__file__).with_name("read_plaid.py")
WRITER = Path(__file__).with_name("make_unit_cells.py")
STRETCH = np.array([1.21, 0.1, 0.9])


@pytest.fixture(autouse=True)
def coarse(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(generate, "CELL_SIZE", 0.1)


def test_square_without_holes() -> None:
    r"""u = (U - I) X, P = μ U + (λ/2 (J² - 1) - μ) U⁻ᵀ and W everywhere."""
    cell = generate.solved(generate.meshed(np.zeros((0, 3))), STRETCH)
    assert cell is not None
    u, lam, mu = (
        cell.stretch_tensor,
        generate.MATERIAL.lame_lambda,
        generate.MATERIAL.lame_mu,
    )
    j = np.linalg.det(u)
    p = mu * u + (lam / 2 * (j**2 - 1) - mu) * np.linalg.inv(u).T
    energy = mu / 2 * (np.trace(u @ u) - 2 - 2 * np.log(j)) + lam / 4 * (j**2 - 1 - 2 * np.log(j))
    fields, rtol = cell.solution.fields, 1e-9
    np.testing.assert_allclose(fields[:, :2], cell.homogeneous, atol=1e-10)
    for column, value in enumerate((p[0, 0], p[0, 1], p[1, 1], p[1, 0], energy), start=2):
        np.testing.assert_allclose(fields[:, column], value, rtol=rtol)
    assert cell.solution.energy == pytest.approx(energy, rel=rtol)


def test_effective_energy_is_the_mean_of_the_density() -> None:
    random = np.random.default_rng(3)
    cell = generate.solved(generate.meshed(generate.random_holes(random)), STRETCH)
    assert cell is not None
    assert cell.mean(cell.solution.fields[:, -1]) == pytest.approx(cell.solution.energy, rel=1e-9)


def test_holes_keep_their_distances() -> None:
    for seed in range(20):
        holes = generate.random_holes(np.random.default_rng(seed))
        x, radius = holes[:, :2], holes[:, 2]
        assert (np.abs(x - 0.5).max(axis=1) + radius <= 0.5 - generate.BETWEEN).all()
        apart = np.linalg.norm(x[:, None] - x, axis=-1) - radius[:, None] - radius
        assert (apart[~np.eye(len(x), dtype=bool)] >= generate.BETWEEN).all()
        low, high = generate.POROSITY
        assert low <= np.pi * (radius**2).sum() <= high


def test_a_cell_depends_on_its_number_alone(tmp_path: Path) -> None:
    for folder, numbers in (("one", (4, 5)), ("other", (5, 4))):
        (tmp_path / folder).mkdir()
        for number in numbers:
            generate.generate(tmp_path / folder, number)
    for first, second in zip(
        read_cells(tmp_path / "one"), read_cells(tmp_path / "other"), strict=True
    ):
        np.testing.assert_array_equal(first.solution.fields, second.solution.fields)


@pytest.mark.slow
def test_files_of_plaid(tmp_path: Path, plaid: Path) -> None:
    """Written by pyplaid under the names of 2D_MultiScHypEl, and read; unsolved ones left out."""
    ours = tmp_path / "ours"
    ours.mkdir()
    random = np.random.default_rng(0)
    for number in range(3):
        mesh = generate.meshed(generate.random_holes(random))
        cell = generate.solved(mesh, STRETCH)
        assert cell is not None
        write_cell(ours / f"{number:05d}.npz", cell)
    for script, source, target in ((WRITER, ours, "plaid"), (READER, tmp_path / "plaid", "back")):
        subprocess.run([plaid, script, source, tmp_path / target], check=True)
    back = read_cells(tmp_path / "back")
    assert len(back) == 2
    for one, other in zip(read_cells(ours), back, strict=False):
        np.testing.assert_array_equal(one.coordinates, other.coordinates)
        np.testing.assert_array_equal(one.triangles, other.triangles)
        np.testing.assert_array_equal(one.solution.fields, other.solution.fields)
        np.testing.assert_array_equal(one.stretch, other.stretch)
        assert one.solution.energy == other.solution.energy
