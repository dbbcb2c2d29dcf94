"""Measures of the studies beyond the paper, on samples made by hand and on made-up datasets."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from matplotlib.colors import LogNorm
from numpy.typing import NDArray

from experiments.beyond.body_maps import draw_maps
from experiments.beyond.coverage import by_node as coverage_by_node
from experiments.beyond.coverage import by_number
from experiments.beyond.places import (
    by_node,
    place_table,
    relative_by_node,
)
from experiments.framework.experiment import Findings
from experiments.framework.resources import Resources
from experiments.measures.errors_on_test_split import split_errors
from experiments.measures.predicted_samples import (
    PredictedSamples,
)
from surrogate.learning.data.dataset import Dataset
from surrogate.learning.probabilistic.distribution import Distribution
from surrogate.mechanics.body.geometry import Geometry

Array = NDArray[np.float64]


def samples_with(
    geometry: Geometry, nodes: list[list[int]], errors: list[float]
) -> PredictedSamples:
    """Unit forces on some nodes; displacements of 1 m; errors the same at all nodes, in m."""
    shape = (len(nodes), *geometry.coordinates.shape)
    force, reference = np.zeros(shape), np.ones(shape)
    for sample, loaded in enumerate(nodes):
        force[sample, loaded] = 1.0
    mean = reference + np.array(errors)[:, None, None]
    std = np.full(shape, 0.1)
    return PredictedSamples(geometry, force, reference, Distribution(mean, std, 0 * std))


@pytest.fixture
def three(dataset: Dataset) -> PredictedSamples:
    """One load, two loads, and one load again; errors of 0.1, 0.3 and 0.2 m."""
    return samples_with(dataset.geometry, [[5], [5, 9], [9]], [0.1, 0.3, 0.2])


def test_measures_of_samples(three: PredictedSamples) -> None:
    """σ = 0.1 m, so that the band of 1.96 σ holds the first error alone."""
    assert three.number.tolist() == [1, 2, 1]
    assert three.error == pytest.approx([0.1, 0.3, 0.2])
    assert three.moved == pytest.approx([1, 1, 1])
    assert three.std == pytest.approx([0.1] * 3)
    assert three.covered.tolist() == [1, 0, 0]
    assert three.relative(three.number == 1) == pytest.approx(0.15)
    assert by_number(three) == {1: 0.5, 2: 0.0}


def test_coverage_by_node(three: PredictedSamples) -> None:
    """One sample of three is inside at every free node; where σ is 1 m, all are."""
    free = three.geometry.free
    three.predicted.std_epistemic[:, 5] = 1.0
    shares = coverage_by_node(three, three.inside)
    assert shares[5] == pytest.approx(100)
    assert shares[9] == pytest.approx(100 / 3)
    assert np.isnan(shares[~free.any(axis=1)]).all()


def test_errors_by_node(three: PredictedSamples) -> None:
    """Node 5 has errors 0.1 and 0.3, node 9 0.3 and 0.2, the others none."""
    errors = by_node(three, three.error)
    assert errors[[5, 9]] == pytest.approx([0.2, 0.25])
    assert np.isnan(np.delete(errors, [5, 9])).all()
    assert relative_by_node(three)[[5, 9]] == pytest.approx([0.2, 0.25])
    (row,) = place_table("beam", {"beam2d_any-forces": three}).rows
    assert row[1:] == pytest.approx((225, 225, 200, 250, 25))


def test_maps_in_the_plane_and_in_space(dataset: Dataset, dataset_3d: Dataset) -> None:
    """One panel a network; marks at the nodes that can be seen.

    These are all 8 × 4 in the plane. In space, of 8 × 4 × 4, they are those of three faces without
    the common edges twice: 32 + 32 + 16 − 8 − 4 − 4 + 1 = 65.
    """
    for data, seen in ((dataset, 32), (dataset_3d, 65)):
        geometry = data.geometry
        errors = np.linspace(0.1, 1.0, len(geometry.coordinates))
        norm = LogNorm(0.1, 2)
        figure = draw_maps(geometry, {"one": errors, "two": 2 * errors}, norm, "mean error [mm]")
        *panels, bar = figure.axes
        assert [axes.get_title() for axes in panels] == ["one", "two"]
        assert bar.get_xlabel() == "mean error [mm]"
        marks = panels[0].collections[-1].get_offsets()
        assert len(np.asarray(marks)) == seen


def test_errors_over_samples_are_those_of_the_test_split(
    resources: Resources, result_of: Callable[[str], Findings]
) -> None:
    table = result_of("training-samples").tables[0]
    assert table.head == ("network", "25", "45")
    errors = {row[0]: row[1:] for row in table.rows}
    for label, kind in (("U-Net, forces in", "forces"), ("GP on modal loads", "modal-gp")):
        expected = [split_errors(resources, f"beam2d_any-{kind}-n{n}").mean_error for n in (25, 45)]
        assert errors[label] == pytest.approx([1e3 * error for error in expected])
