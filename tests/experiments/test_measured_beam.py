"""The measured beam: what the recordings say, and fits to closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from experiments.benchmarks import measured_beam, measured_swing
from experiments.benchmarks.benchmark import stored_record
from experiments.benchmarks.measured_beam import PUBLISHED, Deflection
from experiments.benchmarks.silicone_beam.recordings import (
    MEANT,
    in_frame,
    moved,
    recorded,
    rigid_motion,
    swings,
)

TIP_1 = {"gravity_a": -6.44, "gravity_b": -6.58, "load52_a": -17.15, "load52_b": -17.13}  # mm


@pytest.mark.parametrize("name", TIP_1)
def test_deflections_of_the_recordings(name: str) -> None:
    """Of marker tip 1, from the frame of first motion: within 0.15 mm of the mean held before."""
    held, rest, noise = recorded()[name]
    before, after = in_frame(held, rest)
    assert 1e3 * (after - before)[0, 2] == pytest.approx(TIP_1[name], abs=0.15)
    assert noise.max() < 1e-5
    assert np.abs(after - before)[3:, 1:].max() < 2e-4  # the clamp stays


def test_a_rigid_motion_is_found_and_moves_the_surface() -> None:
    """A turn by 0.2 about y of places on any frame: markers off the surface turn with it."""
    c, s = np.cos(0.2), np.sin(0.2)
    turn = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
    rotation, shift = rigid_motion(MEANT, MEANT @ turn.T + (1, 2, 3))
    np.testing.assert_allclose(rotation, turn, atol=1e-12)
    np.testing.assert_allclose(shift, (1, 2, 3), atol=1e-12)
    rest = MEANT.copy()
    rest[:3] = rest[:3] @ turn.T
    foot = np.array([0, 0.015, 0.03])
    np.testing.assert_allclose(moved(MEANT, rest)[0], turn @ foot - foot, atol=1e-12)


def test_both_loads_tell_modulus_and_held_height() -> None:
    """Deflections that go with 1/E: w = c / E; held 0.4 mm below the straight beam."""
    moduli = PUBLISHED * np.array(measured_beam.FACTORS)
    sizes = {"gravity": 7e-3, "load52": 17e-3, "load101": 27e-3}
    curves = {k: Deflection(moduli, c * PUBLISHED / moduli) for k, c in sizes.items()}
    seen = {k: np.array(c / 0.9 - 4e-4) for k, c in sizes.items()}
    modulus, height, third = measured_beam.together(curves, seen)
    assert float(modulus) == pytest.approx(0.9 * PUBLISHED, rel=1e-5)
    assert float(height) == pytest.approx(4e-4, rel=1e-2)
    assert float(third) == pytest.approx(27e-3 / 0.9 - 4e-4, rel=1e-4)
    assert float(curves["load52"].modulus(np.array(17e-3))) == pytest.approx(PUBLISHED)


def test_factory_and_learner_agree() -> None:
    """Both fit the same body: moduli within 0.5 %, in the committed record."""
    for row in stored_record("measured-beam").findings.numbers["rows"]:
        assert row["learner"]["modulus"] == pytest.approx(row["modulus"], rel=5e-3)


def test_a_vibration_and_its_extremes() -> None:
    """Of e^-2t cos 8πt: extremes where ω sin ωt = -λ cos ωt, seen at 100 Hz within 0.5 %."""
    t, omega = np.arange(100) / 100, 8 * np.pi
    heights = 0.01 * np.exp(-2 * t) * np.cos(omega * t) - 0.01
    frequency, decay = measured_swing.vibration(t, heights, 3.8)
    assert [frequency, decay] == pytest.approx([4.0, 2.0], rel=1e-6)
    at = (np.pi * np.arange(1, 4) - np.arctan(2 / omega)) / omega
    beyond = 0.01 * np.exp(-2 * at) * np.cos(omega * at)
    found = np.array(measured_swing.extremes(heights, -0.01)) + 0.01
    np.testing.assert_allclose(found, beyond, rtol=5e-3)


@pytest.mark.parametrize(("name", "hertz"), [("gravity_a", 7.76), ("load52_b", 4.32)])
def test_frequencies_of_the_recordings(name: str, hertz: float) -> None:
    """Of one cosine over 2 s, fitted to marker tip 1 by others: within 1 %."""
    heights = swings()[name]
    times = np.arange(len(heights)) / 100
    swing = (times > 0.07) & (times < 2)
    assert measured_swing.vibration(times[swing], heights[swing], hertz)[0] == pytest.approx(
        hertz, rel=0.01
    )
