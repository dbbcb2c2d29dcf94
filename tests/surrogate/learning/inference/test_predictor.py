"""Loads alone, in batches and in PyTorch on the grid: one prediction, to rounding."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from torch import nn

from shared_schema.grid import Grid
from surrogate.learning.data.dataset import Dataset
from surrogate.learning.inference.loading import load
from surrogate.learning.inference.surrogate import Surrogate
from surrogate.learning.models.kinds import run_config
from surrogate.learning.models.model import Model
from surrogate.learning.runs.description import describe
from surrogate.mechanics.equilibrium.compliance import Compliance
from surrogate.mechanics.matrices.factors import CLOSE
from surrogate.mechanics.series import small_series
from surrogate.mechanics.series.series_response import SeriesResponse
from surrogate.mechanics.series.small_series import SmallSeries
from tests.surrogate.learning.data.test_embedded_dataset import averaging
from tests.surrogate.mechanics.bodies import in_equilibrium

MECHANICS = {"inputs": ["force", "linear_gradient"], "skip": "linear"}
SERIES = {"inputs": ["last_gradient", "force", "linear_gradient"], "skip": "series"}
KINDS: dict[str, dict[str, Any]] = {
    "plain": {},
    "mechanics": {"network": MECHANICS},
    "series": {"network": SERIES},
    "series mle": {"likelihood": "maximum_likelihood", "network": SERIES},
    "gradient only": {"network": {"inputs": ["linear_gradient"]}},
    "mle": {"likelihood": "maximum_likelihood", "network": MECHANICS},
    "ensemble": {
        "ensemble": 3,
        "network": {"force_transforms": ["linear", "asinh", "saturating"], **MECHANICS},
    },
    "reduced": {"model": "reduced"},
    "reduced series": {"model": "reduced", "network": {"series": [8, 4]}},
    "reduced series, two": {"model": "reduced", "network": {"series": [8, 4]}, "ensemble": 2},
    "reduced ensemble": {"model": "reduced", "ensemble": 2, "likelihood": "maximum_likelihood"},
}
SMALL: dict[str, dict[str, Any]] = {
    "unet": {"levels": 2, "channels": 8},
    "reduced": {"input_modes": 8, "output_modes": 10, "width": 32},
}


def untrained(dataset: Dataset, grid: Grid | None = None, **content: Any) -> Surrogate:
    """A surrogate with random weights, scales from the data, on another grid if one is given."""
    description_of = dataset
    if grid is not None:
        dataset = replace(dataset, geometry=replace(dataset.geometry, grid=grid))
    case = dataset.manifest.name
    if small := SMALL.get(content.get("model", "unet")):
        content["network"] = {**small, **content.get("network", {})}
    config: Model = run_config({"name": "a", "case": case, **content})
    network = config.build(dataset.geometry, dataset.info, dataset.material)
    config.start_from_data(network, dataset, in_equilibrium(dataset).train)
    for name, parameter in network.named_parameters():
        if name.endswith("head.weight"):  # zero in a reduced network
            nn.init.normal_(parameter, std=0.1)
    return Surrogate(network, dataset.geometry, describe(config, description_of))


def loads(dataset: Dataset) -> np.ndarray:
    """No load, a load on one node, loads on all free nodes: (3, n_nodes, d) in N."""
    force = np.zeros((3, *dataset.geometry.coordinates.shape))
    force[1, dataset.geometry.tip] = 1.0
    force[2] = np.random.default_rng(0).normal(size=force[2].shape)
    force[2, dataset.geometry.clamped] = 0.0
    return force


def by_pytorch(model: Surrogate, force: np.ndarray) -> np.ndarray:
    """Means by the network on the grid."""
    return model.predictor.batched.distribution(force, 1, 0).mean


def assert_same_alone(model: Surrogate, dataset: Dataset) -> None:
    """Every load gives the same alone and in a batch, to float32: 5e-6 of the largest value."""
    force = loads(dataset)
    batch = model.predict(force)
    assert np.abs(batch).max() > 1e-3
    for f, expected in zip(force, batch, strict=True):
        found = model.predict(f)
        assert found.dtype == np.float64
        np.testing.assert_allclose(found, expected, rtol=0, atol=5e-6 * np.abs(batch).max())
        np.testing.assert_array_equal(model.predict(f[None])[0], found)


@pytest.mark.parametrize("kind", KINDS)
def test_a_load_alone_and_in_a_batch(dataset: Dataset, kind: str) -> None:
    model = untrained(dataset, **KINDS[kind])
    assert (model.predictor.at_nodes is not None) == kind.startswith("reduced")
    assert_same_alone(model, dataset)
    expected, found = by_pytorch(model, loads(dataset)), model.predict(loads(dataset))
    np.testing.assert_allclose(found, expected, rtol=0, atol=5e-6 * np.abs(expected).max())


@pytest.mark.parametrize("order", [1, 2, 4])
@pytest.mark.parametrize("large", [False, True])
def test_response_alone(
    dataset: Dataset, order: int, large: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without a network, loads are those of PyTorch; the last term is that of the series."""
    if large:
        monkeypatch.setattr(small_series, "MOST", 1000)
    model = untrained(dataset, model="series", series_order=order)
    assert_same_alone(model, dataset)
    force = loads(dataset)
    force = np.concatenate([force, 1e-12 * force[1:]])
    found, last = model.predictor.respond(force)
    for one, expected in zip(found, by_pytorch(model, force), strict=True):
        np.testing.assert_allclose(one, expected, rtol=0, atol=5e-6 * np.abs(expected).max())
    if order == 1:
        np.testing.assert_array_equal(last, np.inf)
        return
    series = model.predictor.series
    assert series is not None
    assert isinstance(series.terms._of_forces, SmallSeries) != large
    series.terms.compiled = False
    expected, of_plain = model.predictor.respond(force)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-6 * np.abs(expected).max())
    np.testing.assert_allclose(last[:3], of_plain[:3], rtol=1e-4)


@pytest.mark.parametrize("model", ["unet", "reduced"])
def test_three_dimensions(dataset_3d: Dataset, model: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Large bodies, for which no matrix is kept."""
    monkeypatch.setattr("surrogate.mechanics.equilibrium.compliance.DENSE", 100)
    assert_same_alone(untrained(dataset_3d, model=model), dataset_3d)


@pytest.mark.parametrize("inputs", [SERIES["inputs"], ["linear_gradient", "last_gradient"]])
def test_series_of_large_bodies(
    dataset_3d: Dataset, inputs: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Cell by cell, by a factor in single precision."""
    monkeypatch.setattr("surrogate.mechanics.equilibrium.compliance.DENSE", 100)
    model = untrained(dataset_3d, network={"inputs": inputs, "skip": "series"})
    assert_same_alone(model, dataset_3d)


def test_embedded_grid(dataset: Dataset) -> None:
    """One node is the mean of two grid points."""
    grid = averaging(dataset.geometry.grid)
    assert not grid.points_are_nodes
    assert_same_alone(untrained(dataset, grid, network=MECHANICS), dataset)


def test_embedded_grid_of_a_large_body(dataset: Dataset, monkeypatch: pytest.MonkeyPatch) -> None:
    """Loads on a few nodes are answered by columns, found once; others are solved for."""
    monkeypatch.setattr("surrogate.mechanics.equilibrium.compliance.DENSE", 0)
    model, force = untrained(dataset, averaging(dataset.geometry.grid), model="reduced"), loads
    assert_same_alone(model, dataset)
    expected, found = by_pytorch(model, force(dataset)), model.predict(force(dataset))
    np.testing.assert_allclose(found, expected, rtol=0, atol=5e-6 * np.abs(expected).max())
    at_nodes = model.predictor.at_nodes
    assert at_nodes is not None
    assert at_nodes.compliance is None
    monkeypatch.setattr(at_nodes.kept, "respond", None)
    model.predict(2 * force(dataset)[1])
    with pytest.raises(TypeError):
        model.predict(np.roll(force(dataset)[1], -1, axis=0))


def test_passes_respond_linearly_once(dataset: Dataset) -> None:
    """The linear response of a load does not depend on the pass, and is computed once."""
    model = untrained(dataset, likelihood="variational_bayes", variational={}, network=MECHANICS)
    assert model.network.linear is not None
    batches: list[int] = []
    model.network.linear.register_forward_hook(lambda _, inputs, __: batches.append(len(inputs[0])))
    model.predict_distribution(loads(dataset), passes=5)
    assert batches == [3]


@pytest.mark.filterwarnings("ignore::surrogate.OutsideTrainingWarning")
@pytest.mark.parametrize(
    ("name", "close", "close_under_many"),
    [
        ("beam2d_any", 1e-9, 1e-9),
        ("lshape2d_any", 1e-8, 1e-8),
        ("beam3d_any_reduced", 1e-4, 1e-4),
        ("finger3d", 1e-6, CLOSE),
        pytest.param("beam3d_any", CLOSE, CLOSE, marks=pytest.mark.slow),
    ],
)
def test_a_load_in_a_batch_is_that_load_alone(
    name: str, close: float, close_under_many: float
) -> None:
    """To rounding errors; where a factor in single precision solves, to those that it may have.

    A search in modes ends a step earlier or later: to a twentieth of its last step, 2e-3.

    Most nodes of the last load are loaded, and those of a large body are solved for.
    """
    model = load(name)
    random = np.random.default_rng(0)
    forces = np.zeros((20, *model.geometry.coordinates.shape))
    nodes = np.flatnonzero(model.geometry.loadable)
    limit = 0.3 * max(model.description.data.info.force.max_abs)
    for force in forces:
        force[random.choice(nodes, 2, replace=False)] = random.uniform(-limit, limit, 2)[:, None]
    forces[-1, nodes] = limit / len(nodes)
    few, many = model.predict(forces[-5:]), model.predict(forces)
    for k in range(-5, 0):
        alone = model.predict(forces[k])
        bound = (close if k < -1 else close_under_many) * np.abs(alone).max()
        np.testing.assert_allclose(few[k], alone, rtol=0, atol=bound)
        np.testing.assert_allclose(many[k], alone, rtol=0, atol=bound)


@pytest.mark.filterwarnings("ignore::surrogate.OutsideTrainingWarning")
def counted_solves(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Return a list that gets the number of loads of every solve from now on."""
    solved: list[int] = []
    solve = Compliance.solve

    def counted(self: Compliance, force: np.ndarray) -> np.ndarray:
        solved.append(len(force))
        return solve(self, force)

    monkeypatch.setattr(Compliance, "solve", counted)
    return solved


def test_loads_on_an_embedded_grid_share_solves(
    dataset: Dataset, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Loads on all nodes, 65 of them, are two solves."""
    monkeypatch.setattr("surrogate.mechanics.equilibrium.compliance.DENSE", 0)
    model = untrained(dataset, averaging(dataset.geometry.grid), model="reduced")
    solved = counted_solves(monkeypatch)
    model.predict(np.arange(1, 66)[:, None, None] * loads(dataset)[2])
    assert solved == [64, 1]


def test_what_the_loads_of_a_batch_share_is_read_once(
    dataset_3d: Dataset, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Every term of the series on a large body is one solve, for all loads of a batch."""
    monkeypatch.setattr("surrogate.mechanics.equilibrium.compliance.DENSE", 100)
    monkeypatch.setattr("surrogate.mechanics.equilibrium.kept_responses.LOADED", 0)
    model = untrained(dataset_3d, network=SERIES)
    solved = counted_solves(monkeypatch)
    force = loads(dataset_3d)
    some = force[force.any(axis=(1, 2))]
    model.predict(some)
    assert isinstance(model.network.linear, SeriesResponse)
    assert solved == [len(some)] * model.network.linear.order
