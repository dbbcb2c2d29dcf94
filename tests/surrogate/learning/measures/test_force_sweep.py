from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from surrogate.figures.curves import sweep_curves
from surrogate.learning.data.samples import NodalSamples
from surrogate.learning.inference.loading import load
from surrogate.learning.measures.extrapolation import Extrapolation
from surrogate.learning.measures.force_sweep import force_sweep
from surrogate.learning.probabilistic.distribution import Distribution
from tests.surrogate.force_sweeps import hand_made


@pytest.fixture
def extrapolation(trained: Path) -> Extrapolation:
    """Forces 3, −1 and 0 N along y at node 5, u = f, μ = u + 0.1 m, σ = (0.3, 0.4) m."""
    surrogate = load(trained)
    shape = (3, *surrogate.geometry.coordinates.shape)
    force = np.zeros(shape)
    force[:, 5, 1] = 3.0, -1.0, 0.0
    predicted = Distribution(force + 0.1, np.full(shape, 0.3), np.full(shape, 0.4))
    return Extrapolation("made-up", surrogate, NodalSamples(force, force), predicted)


def test_the_loaded_component_in_order(extrapolation: Extrapolation) -> None:
    """The made-up forces in training are drawn from ±2.5 N."""
    sweep = force_sweep(extrapolation)
    assert sweep.axis == 1
    assert sweep.limit == pytest.approx(2.5, abs=0.11)
    np.testing.assert_allclose(sweep.force, [-1, 0, 3])
    np.testing.assert_allclose(sweep.reference, [-1, 0, 3])
    np.testing.assert_allclose(sweep.error, 0.1)
    np.testing.assert_allclose(sweep.std, 0.5)
    np.testing.assert_array_equal(sweep.outside, [False, False, True])
    np.testing.assert_array_equal(sweep.covered_components, 1.0)


def test_all_components_of_the_loaded_node(extrapolation: Extrapolation) -> None:
    """Errors of 0.1 m in both components: √0.02 m; then 1 m across the largest force, 2 σ."""
    across = extrapolation.predicted.mean
    across[0, 5, 0] = 1.0
    sweep = force_sweep(extrapolation)
    np.testing.assert_allclose(sweep.node_error, np.sqrt([0.02, 0.02, 1.01]))
    np.testing.assert_allclose(sweep.moved, [1, 0, 3])
    np.testing.assert_array_equal(sweep.covered, [True, True, True])
    np.testing.assert_array_equal(sweep.covered_across, [True, True, False])


def test_inside_the_band() -> None:
    """The limit is 1.959964 σ = 0.980 m with σ = 0.5 m."""
    std = np.full(9, 0.5)
    mean = np.arange(-4.0, 5.0) + 0.979
    sweep = hand_made(mean=mean, std_epistemic=std)
    assert sweep.covered.all()
    assert not hand_made(mean=mean + 0.002, std_epistemic=std).covered.any()


def test_growth_is_that_of_the_worse_side() -> None:
    """Two forces a side: σ grows on one side (+1), and falls on the other (−1)."""
    assert hand_made().growth == 1.0
    falling = np.array([3.0, 9.0, 1, 1, 1, 1, 1, 9, 16])
    assert hand_made(std_epistemic=falling).growth == -1.0


def test_values_at_a_force_of_both_senses() -> None:
    """The mean at ±3 N is (1 + 3) / 2."""
    sweep = hand_made()
    assert sweep.at(2.9, np.array([0, 1, 0, 0, 0, 0, 0, 3.0, 0])) == 2.0


def test_figure(extrapolation: Extrapolation) -> None:
    """Errors of 100 mm, 95 % bands of ±1.959964 · 0.5 m; the deterministic network as well."""
    figure = sweep_curves(extrapolation, extrapolation, "U-Net (VB)")
    left, right = figure.axes
    assert left.get_xlabel() == "force component y at the node [N]"
    assert [text.get_text() for text in figure.legends[0].get_texts()] == [
        "95 % band",
        "finite elements",
        "U-Net (VB)",
        "U-Net (D)",
        "epistemic σ",
    ]
    _, error, other = right.lines
    np.testing.assert_allclose(np.asarray(error.get_ydata()), 100.0)
    np.testing.assert_allclose(np.asarray(other.get_ydata()), 100.0)
    band = np.asarray(right.collections[0].get_paths()[0].vertices)[:, 1]
    np.testing.assert_allclose([band.min(), band.max()], [-979.982, 979.982], rtol=1e-5)
