"""Other programs side by side: their scripts, what is given to them, and the errors of answers."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import surrogate
from experiments.benchmarks import side_by_side
from experiments.benchmarks.others.measured import tetrahedra
from experiments.benchmarks.side_by_side import OTHERS, OURS, PROGRAMS, Problem, lines_of
from surrogate.mechanics import Load, Series


def test_every_program_has_a_script_of_few_lines() -> None:
    scripts = {path.stem for path in OTHERS.glob("by_*.py")}
    assert scripts == set(PROGRAMS)
    assert all(10 < lines_of(script) < 80 for script in scripts)


def test_hexahedra_are_split_without_gaps() -> None:
    """Six tetrahedra of a unit cube, none inside out, fill 1 m³."""
    corners = np.array(
        [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]]
    )
    x = corners[tetrahedra(np.arange(8)[None])]
    volumes = np.linalg.det(x[:, 1:] - x[:, :1]) / 6
    assert (volumes > 0).all()
    assert volumes.sum() == pytest.approx(1.0)


def test_own_ways_come_nearer_to_the_equilibrium() -> None:
    """On the 2D beam of the package; a page and a figure of what is measured."""
    body = surrogate.load("beam2d_any").body
    force = np.zeros(body.geometry.coordinates.shape)
    force[-1] = 0.0, -1.0
    series, load = Series(body), Load(force)
    found = {way: predict(series, load) for way, predict in OURS.items()}
    truth = body.correct(load, found["`surrogate`, load series"]).displacement
    problem = Problem(Path(), body, load, truth[None])
    times = np.array([2.0, 1.0])
    rows = [problem.row(way, 3, u[None], times) for way, u in found.items()]
    errors = [row["error"] for row in rows]
    assert errors[-1] < 1e-7
    assert errors[-1] < errors[2] <= errors[0] < 1e-2
    assert (rows[0]["first_s"], rows[0]["next_s"], rows[0]["nodes"]) == (2.0, 1.0, 64)
    results = {"case": "beam2d_any", "nodes": 64, "rows": rows}
    assert side_by_side.page(results).count("| 3 | 1 | 2 | 1 |") == len(OURS)
    assert len(side_by_side.draw(results).axes) == 1
