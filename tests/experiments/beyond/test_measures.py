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
from experiments.beyond.loads_by_number import number_table
from experiments.beyond.places import (
    by_node,
    distance_table,
    place_table,
    relative_by_node,
)
from experiments.beyond.training_samples import Point, series_table
from experiments.beyond.uncertainty_outside import group_table, number_groups, reach_groups
from experiments.framework.experiment import Findings
from experiments.framework.resources import Resources
from experiments.measures.errors_on_test_split import split_errors
from experiments.measures.predicted_samples import (
    PredictedSamples,
    distance_from,
    distance_groups,
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


def test_distance_from_nodes(dataset: Dataset) -> None:
    """Nodes are numbered along y first, 0.5 m apart, 4 in a column: 5 is at (0.5, 0.5)."""
    samples = samples_with(dataset.geometry, [[7], [5], [4]], [0.1] * 3)
    nodes = np.isclose(dataset.geometry.coordinates[:, 1], 1.5)
    assert distance_from(samples, nodes) == pytest.approx([0, 1, 1.5])


def test_groups_of_distances() -> None:
    """Few distances are groups of their own; 24 different ones make zero and six of four each."""
    groups = distance_groups(np.array([0.0, 1.0, 0.0]))
    assert [(d, mask.tolist()) for d, mask in groups] == [
        (0, [True, False, True]),
        (1, [False, True, False]),
    ]
    many = distance_groups(np.append(0.0, np.arange(1.0, 25)))
    assert [int(mask.sum()) for _, mask in many] == [1, 4, 4, 4, 4, 4, 4]
    assert np.sum([mask for _, mask in many], axis=0).tolist() == [1] * 25
    assert many[1][0] == pytest.approx(2.5)


def test_table_by_group(three: PredictedSamples) -> None:
    """Half of the errors under one load are inside the band, none of that under two."""
    table = group_table("beam", {"beam2d_any-mechanics-vb": three}, number_groups(three))
    assert table.head == ("network", "", "1", "2")
    assert [row[2:] for row in table.rows] == [
        pytest.approx((150, 300)),
        pytest.approx((100, 100)),
        pytest.approx((50, 0)),
    ]


def test_table_by_number(resources: Resources, dataset: Dataset) -> None:
    """Relative errors 10, 14 and 31 % under one, two and three loads."""
    samples = samples_with(dataset.geometry, [[5], [5, 9], [5, 9, 13]], [0.1, 0.14, 0.31])
    (row,) = number_table(resources, {"beam2d_any-mechanics": samples}, 4, relative=True).rows
    assert row[2:5] == pytest.approx((10, 14, 31))
    assert row[5] is None


def test_table_by_distance(dataset: Dataset) -> None:
    samples = samples_with(dataset.geometry, [[7], [4]], [0.001, 0.09])
    groups = distance_groups(np.array([0.0, 1.5]))
    table = distance_table("beam", {"beam2d-mechanics": samples}, groups)
    assert table.rows[0][1:] == pytest.approx((1, 90))


def test_table_of_a_series() -> None:
    """Errors, or minutes, by the number of samples; a dash where there is no run."""
    series = {
        "U-Net, forces in": {250: Point(4.0, 1), 1000: Point(2.0, 3)},
        "reduced network": {250: Point(0.9, 2)},
    }
    assert series_table("beam", series, minutes=False).rows == (
        ("U-Net, forces in", 4.0, 2.0),
        ("reduced network", 0.9, None),
    )
    assert series_table("beam", series, minutes=True).rows[0] == ("U-Net, forces in", 1, 3)


def test_groups_of_reach() -> None:
    """The corner of the range, 1.005 after rounding, is inside."""
    groups = reach_groups(np.array([0.0, 0.5, 1.005, 1.4, 4.0]))
    assert [(label, mask.nonzero()[0].tolist()) for label, _, mask in groups] == [
        ("up to 1 a", [1, 2]),
        ("up to 1.5 a", [3]),
        ("up to 4 a", [4]),
    ]


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


def test_table_of_places(resources: Resources, result_of: Callable[[str], Findings]) -> None:
    """The made-up loads are all on the nodes of the training: one distance, zero."""
    places, distances = result_of("places").tables
    assert distances.head == ("network", "0.00 m")
    loads = resources.predicted_loads("beam2d-forces", "beam2d_places")
    error = np.abs(loads.predicted.mean - loads.samples.displacement).mean()
    row = next(row for row in distances.rows if row[0] == "U-Net, forces in, single loads")
    assert row[1] == pytest.approx(1e3 * error)
    assert [row[0] for row in places.rows] == [row[0] for row in distances.rows]


def test_table_of_forces(resources: Resources, result_of: Callable[[str], Findings]) -> None:
    """±8 N are 3.2 times the 2.5 N of the made-up training: no column of 4 a."""
    rows = result_of("force-sizes").tables[0].rows
    assert [row[2] for row in rows] == pytest.approx([2.5] * 5, rel=0.05)
    assert all(row[-1] is None and row[-2] is not None for row in rows)


@pytest.mark.slow
def test_times_of_all_kinds(result_of: Callable[[str], Findings]) -> None:
    """The made-up solutions take 0.5 s each."""
    rows = result_of("times").tables[0].rows
    assert {row[4] for row in rows} == {500.0}
    assert {row[1]: row[2] for row in rows}["VB with mechanics"] == 4
    assert all(row[5] == pytest.approx(500.0 / float(row[3] or 0)) for row in rows)
