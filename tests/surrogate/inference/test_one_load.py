"""A single load, predicted in NumPy, against the same load in a batch, predicted in PyTorch."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from surrogate.data.dataset import Dataset
from surrogate.inference import one_load
from surrogate.inference.prediction import Surrogate, load
from surrogate.models.model import Model
from surrogate.runs.configuration import run_config
from surrogate.runs.description import describe
from tests.surrogate.data.test_embedded_dataset import averaging
from tests.surrogate.plane_strain import plane_strain_stiffness, sparse

MECHANICS = {"inputs": ["force", "linear_gradient"], "skip": "linear"}
KINDS: dict[str, dict[str, Any]] = {
    "plain": {},
    "mechanics": {"network": MECHANICS},
    "gradient only": {"network": {"inputs": ["linear_gradient"]}},
    "mle": {"likelihood": "maximum_likelihood", "network": MECHANICS},
    "ensemble": {
        "ensemble": 3,
        "network": {"force_transforms": ["linear", "asinh", "saturating"], **MECHANICS},
    },
}


@pytest.fixture(scope="module")
def stiff(dataset: Dataset) -> Dataset:
    return replace(dataset, stiffness=sparse(plane_strain_stiffness(dataset.geometry)))


def untrained(dataset: Dataset, **content: Any) -> Surrogate:
    """A surrogate with random weights, scales from the data."""
    case = dataset.manifest.name
    small = {"levels": 2, "channels": 8, **content.pop("network", {})}
    config: Model = run_config({"name": "a", "case": case, "network": small, **content})
    network = config.build(dataset.geometry, dataset.info)
    config.start_from_data(network, dataset, dataset.train)
    return Surrogate(network, dataset.geometry, describe(config, dataset))


def loads(dataset: Dataset) -> np.ndarray:
    """No load, a load on one node, loads on all free nodes: (3, n_nodes, d) in N."""
    force = np.zeros((3, *dataset.geometry.coordinates.shape))
    force[1, dataset.geometry.tip] = 1.0
    force[2] = np.random.default_rng(0).normal(size=force[2].shape)
    force[2, dataset.geometry.clamped] = 0.0
    return force


def assert_same_alone(model: Surrogate, dataset: Dataset) -> None:
    """Every load gives the same alone and in a batch, to float32: 2e-6 of the largest value."""
    force = loads(dataset)
    batch = model.predict(force)
    assert np.abs(batch).max() > 1e-3
    for f, expected in zip(force, batch, strict=True):
        found = model.predict(f)
        assert found.dtype == np.float64
        np.testing.assert_allclose(found, expected, rtol=0, atol=2e-6 * np.abs(batch).max())
        np.testing.assert_array_equal(model.predict(f[None])[0], found)


@pytest.mark.parametrize("kind", KINDS)
def test_a_load_alone_and_in_a_batch(stiff: Dataset, kind: str) -> None:
    model = untrained(stiff, **KINDS[kind])
    assert model._one_load is not None
    assert model._one_load.matrix is not None
    assert_same_alone(model, stiff)


def test_large_bodies_have_no_matrix(stiff: Dataset, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(one_load, "LARGEST", 1000)
    model = untrained(stiff, network=MECHANICS)
    assert model._one_load is not None
    assert model._one_load.matrix is None
    assert_same_alone(model, stiff)


def test_three_dimensions(dataset_3d: Dataset) -> None:
    assert_same_alone(untrained(dataset_3d), dataset_3d)


def test_embedded_grid(stiff: Dataset) -> None:
    """One node is the mean of two grid points."""
    grid = averaging(stiff.geometry.grid)
    assert not grid.points_are_nodes
    between = replace(stiff, geometry=replace(stiff.geometry, grid=grid))
    assert_same_alone(untrained(between, network=MECHANICS), between)


def test_distribution_of_a_deterministic_network(trained: Path, dataset: Dataset) -> None:
    model = load(trained)
    force = loads(dataset)[2]
    found = model.predict_distribution(force)
    np.testing.assert_array_equal(found.mean, model.predict(force))
    assert not found.std.any()


def test_stochastic_networks_average_their_passes(make_run: Callable[..., Path]) -> None:
    model = load(make_run(epochs=1, likelihood="variational_bayes"))
    force = np.zeros(model.geometry.coordinates.shape)
    force[model.geometry.tip] = 1.0
    assert model._one_load is None
    np.testing.assert_array_equal(model.predict(force), model.predict_distribution(force).mean)


def test_passes_respond_linearly_once(stiff: Dataset) -> None:
    """The linear response of a load does not depend on the pass, and is computed once."""
    model = untrained(stiff, likelihood="variational_bayes", variational={}, network=MECHANICS)
    assert model.network.linear is not None
    batches: list[int] = []
    model.network.linear.register_forward_hook(lambda _, inputs, __: batches.append(len(inputs[0])))
    model.predict_distribution(loads(stiff), passes=5)
    assert batches == [3]
