"""Load paths are the equilibria of finite changes of the load, up to terms of third order."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from surrogate.contrib.sample_paths import REMAINDER, follow, neighbours, random_changes
from surrogate.mechanics.certify.correction import correct
from surrogate.mechanics.equilibrium.out_of_balance import Equilibrium
from tests.surrogate.mechanics.bodies import MATERIAL, box, end_load

FORCES = {"quad": (3.0, -9.0), "tetra": (3.0, -9.0, 5.0)}


@pytest.mark.parametrize("cell_type", FORCES)
def test_remainder_is_of_third_order(cell_type: str) -> None:
    """Equilibria at ±t and ±t / 2, by Newton's method; the remainders differ by about 2³."""
    geometry = box(cell_type)
    equilibrium = Equilibrium(geometry, MATERIAL)
    force = end_load(geometry, *FORCES[cell_type])
    u = correct(equilibrium, force, np.zeros_like(force)).displacement
    change = random_changes(force, neighbours(geometry), 1.0, 3, np.random.default_rng(1))
    paths = follow(equilibrium, u, force, 0.2 * change)
    for step, first, second in zip(paths.change, paths.first, paths.second, strict=True):
        assert np.linalg.norm(step) > 0.2

        def remainder(t: float) -> float:
            there = correct(equilibrium, force + t * step, u, 1e-11).displacement  # noqa: B023
            return float(np.linalg.norm(there - (u + t * first + t**2 * second)))  # noqa: B023

        assert 4.5 < remainder(1.0) / remainder(0.5) < 18
        assert 4.5 < remainder(-1.0) / remainder(-0.5) < 18
        assert remainder(1.0) < 0.1 * np.linalg.norm(second)


@pytest.mark.parametrize("load", [(3.0, -9.0), (1.0, -3.0), (0.5, -1.0), (2.0, 3.0)])
def test_paths_end_where_the_remainder_counts(load: tuple[float, float]) -> None:
    """A change of 30 times the load is shortened; its remainder is 1e-4 of u, up to a factor."""
    geometry = box("quad")
    equilibrium = Equilibrium(geometry, MATERIAL)
    force = end_load(geometry, *load)
    u = correct(equilibrium, force, np.zeros_like(force)).displacement
    paths = follow(equilibrium, u, force, 30 * force[None])
    assert 0.01 < paths.change[0, -1, 0] / force[-1, 0] < 1
    there = correct(equilibrium, force + paths.change[0], u).displacement
    remainder = np.linalg.norm(there - (u + paths.first[0] + paths.second[0]))
    assert 0.02 < remainder / (REMAINDER * np.linalg.norm(u)) < 2


def test_a_change_of_a_load_keeps_its_nodes_and_neighbours() -> None:
    """Of the load at a corner: forces at the corner and at its loadable neighbours only."""
    geometry = box("quad")
    last = len(geometry.coordinates) - 1
    loadable = geometry.loadable & (geometry.coordinates[:, 1] == 1)
    beside = neighbours(replace(geometry, loadable=loadable))
    assert beside[last].tolist() == [last - 4]  # the node before it on the upper edge, 4 a column
    force = end_load(geometry, 0.0, -2.0)
    change = random_changes(force, beside, 0.1, 50, np.random.default_rng(0))
    assert np.flatnonzero(change.any(axis=(0, 2))).tolist() == [last - 4, last]
    moved = change[:, last - 4, 1]
    assert np.all(np.abs(moved) <= 2)
    assert np.ptp(moved) > 3
    rest = change.sum(axis=1)
    np.testing.assert_allclose(rest.std(), 0.1, rtol=0.3)


def test_no_path_leaves_an_unstable_state() -> None:
    """A body compressed to a tenth of its length has a tangent that is not positive definite."""
    geometry = box("quad")
    equilibrium = Equilibrium(geometry, MATERIAL)
    u = geometry.coordinates * [-0.9, 0.0]
    force = np.zeros_like(u)
    paths = follow(equilibrium, u, force, np.ones((2, *u.shape)))
    assert not paths.change.any()
    assert not paths.first.any()
    assert not paths.second.any()
