"""Corrections leave unstable equilibria: a slender column under less and more than Euler's load."""

from __future__ import annotations

import numpy as np
import pytest

from surrogate.mechanics.body.geometry import Geometry
from surrogate.mechanics.certify.correction import correct
from surrogate.mechanics.certify.full_certificate import certify
from surrogate.mechanics.equilibrium.out_of_balance import Equilibrium
from tests.surrogate.mechanics.bodies import MATERIAL, box

LENGTH, HEIGHT = 10.0, 0.5


@pytest.fixture(scope="module")
def geometry() -> Geometry:
    """A column of 10 m × 0.5 m, clamped at x = 0."""
    plain = box("quad")
    slender = plain.coordinates * [LENGTH / 2, HEIGHT]
    return type(plain)(**{**vars(plain), "coordinates": slender})


@pytest.fixture(scope="module")
def column(geometry: Geometry) -> Equilibrium:
    return Equilibrium(geometry, MATERIAL)


@pytest.fixture(scope="module")
def end(geometry: Geometry) -> np.ndarray:
    """A uniform pressure's forces at the end, of 1 N in all."""
    force = np.zeros_like(geometry.coordinates)
    force[-4:, 0] = np.array([-1, -2, -2, -1]) / 6
    return force


@pytest.fixture(scope="module")
def critical(column: Equilibrium, end: np.ndarray) -> float:
    """Largest force in N under which the straight column is stable, by halving of an interval."""
    low, high = 0.0, 10.0
    while high - low > 1e-6 * high:
        middle = (low + high) / 2
        straight = compressed(column, middle * end)
        low, high = (middle, high) if column.unstable_mode(straight) is None else (low, middle)
    return low


def compressed(column: Equilibrium, force: np.ndarray) -> np.ndarray:
    """Equilibrium of the straight column, (1, n_nodes, d), by steps whose mean is symmetric."""
    u = column.linear_response(force[None])
    while np.linalg.norm(column.out_of_balance(u, force[None])) > 1e-11 * np.linalg.norm(force):
        u = u + column.newton_steps(u, force[None]).steps
        u = (u + mirrored(u)) / 2
    return u


def mirrored(u: np.ndarray) -> np.ndarray:
    """The mirror image of a displacement about the column's axis; 4 nodes across."""
    across = u.reshape(len(u), -1, 4, 2)[:, :, ::-1] * [1, -1]
    return across.reshape(u.shape)


def test_critical_load_is_that_of_euler(
    column: Equilibrium, end: np.ndarray, critical: float
) -> None:
    """π² E' I / (4 L²), with the stiffness E' I by which these elements bend, P L³ / (3 E' I).

    The elements' shear and compression change it by the order of the critical strain, 0.2 %.
    """
    across = np.abs(end[:, ::-1]) * 1e-3
    deflection = column.linear_response(across[None])[0, -4:, 1].mean()
    bending = 1e-3 * LENGTH**3 / (3 * deflection)
    assert critical == pytest.approx(np.pi**2 * bending / (4 * LENGTH**2), rel=1e-2)


@pytest.mark.parametrize("part", [0.5, 0.999, 1.00001, 1.001, 1.3, 3.0])
def test_buckled_above_the_critical_load(
    column: Equilibrium, end: np.ndarray, critical: float, part: float
) -> None:
    """The straight state as a start: kept below; above left, for one of less energy.

    Near the critical load the deflection grows with the root of the excess (pitchfork).
    """
    force = part * critical * end
    straight = compressed(column, force)
    found = correct(column, force, straight[0])
    deflection = abs(found.displacement[-1, 1] + found.displacement[-4, 1]) / 2
    if part < 1:
        assert found.left == 0
        assert deflection < 1e-6
        return
    assert found.left == 1
    assert "past an unstable equilibrium" in found.summary()
    u = found.displacement[None]
    assert column.unstable_mode(u) is None
    assert column.potential(u, force[None]) < column.potential(straight, force[None])
    # Elastica: w² = 8 (P / P_c − 1) (2 L / π)², in first order (Timoshenko and Gere, Eq. 2-13)
    if part < 1.01:
        grown = np.sqrt(8 * (part - 1)) * 2 * LENGTH / np.pi
        assert deflection == pytest.approx(grown, rel=0.1)


def test_mirror_image_by_the_start(column: Equilibrium, end: np.ndarray, critical: float) -> None:
    """A start beside the straight state decides; the two results are mirror images."""
    force = 1.5 * critical * end
    straight = compressed(column, force)
    mode = column.unstable_mode(straight)
    assert mode is not None
    beside = 0.05 * mode / np.abs(mode).max()
    above, below = (
        correct(column, force, (straight + sign * beside)[0]).displacement
        for sign in (np.sign(mode[0, -1, 1]), -np.sign(mode[0, -1, 1]))
    )
    assert above[-1, 1] > 1.0
    np.testing.assert_allclose(mirrored(below[None])[0], above, atol=1e-6)


def test_unstable_state_is_not_certified(
    column: Equilibrium, end: np.ndarray, critical: float
) -> None:
    """Forces balance in the straight state, and yet no tolerance is met."""
    force = 1.5 * critical * end
    found = certify(column, force, compressed(column, force)[0])
    assert found.out_of_balance < 1e-6
    assert not found.certified(1e-3)
    assert found.refusal(1e3) == (
        "the estimate does not settle, no stable equilibrium is near (a force on one node alone "
        "strains a fine mesh without bound)"
    )
