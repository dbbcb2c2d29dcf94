"""Bodies with rollers and symmetry planes: networks of every likelihood learn, on any grid."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from shared_schema.grid import Grid, grid_arrays
from surrogate.learning.data.case_loads import RandomLoads
from surrogate.learning.data.dataset import Dataset
from surrogate.learning.data.joined_dataset import read_dataset
from surrogate.learning.evaluation.run_evaluation import evaluate
from surrogate.learning.inference.export import NodalFunction
from surrogate.learning.inference.loading import load
from surrogate.learning.models.kinds import run_config
from surrogate.learning.models.model import TrainedModel
from surrogate.learning.networks.linear_map import compliance_of
from surrogate.learning.training.loop import train
from surrogate.learning.training.setup import make_trainer, split_for
from surrogate.mechanics.body.geometry import Geometry, at_free
from tests.surrogate.conftest import CELL_TYPES, make_mesh
from tests.surrogate.plane_strain import plane_strain_stiffness, sparse
from tests.surrogate.rollers import held_components, rolling

UNET = {"levels": 2, "channels": 8, "padding": 1, "batch_norm": False}
NETWORKS: dict[str, dict[str, Any]] = {
    "U-Net": {"network": UNET},
    "U-Net with mechanics": {
        "network": {**UNET, "inputs": ["force", "linear_gradient"], "skip": "linear"}
    },
    "reduced network": {
        "model": "reduced",
        "network": {"input_modes": 6, "output_modes": 8, "width": 16, "depth": 2},
    },
}
LIKELIHOODS: dict[str, dict[str, Any]] = {
    "deterministic": {},
    "maximum_likelihood": {"errors": "laplace", "recalibrate": 0.95},
    "variational_bayes": {"recalibrate": True},
}


@pytest.fixture(scope="module")
def body(tmp_path_factory: pytest.TempPathFactory) -> Callable[[int, bool], Path]:
    """Structured dataset of the plate (2) or the block (3), on its nodes or embedded."""

    @cache
    def made(dimension: int, embedded: bool) -> Path:
        return rolling(tmp_path_factory.mktemp("rollers"), dimension, embedded)

    return made


def config_of(dataset: Dataset, network: str, likelihood: str, epochs: int) -> TrainedModel:
    content: dict[str, Any] = {
        "name": "rolling",
        "case": dataset.manifest.name,
        "likelihood": likelihood,
        **NETWORKS[network],
        "training": {
            "epochs": epochs,
            "batch_size": 8,
            "optimiser": {"name": "muon", "learning_rate": 5e-3},
            "validation_fraction": 0.1,
            "calibration_fraction": 0.4,
            **LIKELIHOODS[likelihood],
        },
    }
    if likelihood == "variational_bayes":
        content["variational"] = {"posterior_std": "gauss_newton"}
    config = run_config(content)
    assert isinstance(config, TrainedModel)
    return config


def learns(data: Path, run: Path, network: str, likelihood: str, epochs: int) -> None:
    """Losses fall; what is held neither moves nor has a spread; intervals hold what they should.

    Of 12 test samples, intervals of 0.95 hold 0.95 of the components to within some correlated
    samples: 0.7 at least.
    """
    dataset = read_dataset(data)
    train(config_of(dataset, network, likelihood, epochs), dataset, run, device="cpu")
    losses = [json.loads(line) for line in (run / "metrics.jsonl").read_text().splitlines()]
    assert all(math.isfinite(line["train_loss"]) for line in losses)
    assert losses[-1]["train_loss"] < losses[0]["train_loss"]
    evaluation = evaluate(run, data, passes=10, conformal=0.5)
    assert evaluation.intervals is not None
    model, force = load(run), dataset.nodal_test.force
    held, found = dataset.geometry.held, model.averaged_passes(force, 10, 0)
    np.testing.assert_array_equal(found.mean[:, held], 0)
    np.testing.assert_array_equal(found.std[:, held], 0)
    assert np.abs(found.mean[:, ~held]).min() > 0
    lower, upper = evaluation.intervals.bounds("marginal", found.mean, model.score_scale(found))
    np.testing.assert_array_equal((upper - lower)[:, held], 0)
    assert (upper - lower)[:, ~held].min() > 0
    alone, function = model.predict(force[0]), NodalFunction(model.predictor.network, None)
    largest = np.abs(found.mean).max()
    np.testing.assert_array_equal(alone[held], 0)
    if not model.is_stochastic:
        np.testing.assert_allclose(alone, found.mean[0], rtol=0, atol=1e-5 * largest)
        with torch.no_grad():
            written = function(torch.from_numpy(force).float())["displacement"]
        np.testing.assert_allclose(written, found.mean, rtol=0, atol=1e-5 * largest)
    if likelihood == "deterministic":
        return
    assert found.std[:, ~held].min() > 0
    uncertainty = evaluation.content["uncertainty"]
    assert math.isfinite(uncertainty["negative_log_likelihood"])
    assert uncertainty["intervals"][2]["coverage"] > 0.7
    inside = np.abs(found.mean - dataset.nodal_test.displacement) <= 1.96 * found.std
    assert inside[:, ~held].mean() > 0.7


@pytest.mark.parametrize("likelihood", LIKELIHOODS)
@pytest.mark.parametrize("network", NETWORKS)
def test_plate_with_two_symmetry_planes(
    body: Callable[[int, bool], Path], tmp_path: Path, network: str, likelihood: str
) -> None:
    learns(body(2, False), tmp_path / "run", network, likelihood, 3)


@pytest.mark.slow
@pytest.mark.parametrize(("dimension", "embedded"), [(2, True), (3, False), (3, True)])
@pytest.mark.parametrize(
    ("network", "likelihood"),
    [
        ("U-Net", "variational_bayes"),
        ("U-Net with mechanics", "maximum_likelihood"),
        ("reduced network", "variational_bayes"),
    ],
)
def test_other_bodies_and_grids(
    body: Callable[[int, bool], Path],
    tmp_path: Path,
    network: str,
    likelihood: str,
    dimension: int,
    embedded: bool,
) -> None:
    learns(body(dimension, embedded), tmp_path / "run", network, likelihood, 4)


def test_number_of_data_counts_components(body: Callable[[int, bool], Path]) -> None:
    """64 components less 4 + 8 that are held; 24 training samples of 48."""
    dataset = read_dataset(body(2, False))
    config = config_of(dataset, "U-Net", "variational_bayes", 1)
    trainer = make_trainer(config, dataset, split_for(config, dataset), torch.device("cpu"))
    assert trainer.elbo is not None
    assert trainer.elbo.data == len(trainer.train) * 52


def test_compliance_of_rollers() -> None:
    """K⁻¹ of the free components, and zeros: held forces have no effect."""
    mesh, held = make_mesh(2), held_components(2)
    mesh |= {"mesh/held": held, "mesh/clamped": np.asarray(held.all(axis=1))}
    grid = grid_arrays(Grid.from_coordinates(mesh["mesh/coordinates"]))
    geometry = Geometry.from_arrays(mesh | grid, CELL_TYPES[2])
    k, nodes = plane_strain_stiffness(geometry), np.flatnonzero(~geometry.clamped)
    found = compliance_of(sparse(k), nodes, geometry.free).numpy()
    by_component = geometry.free[nodes].T.ravel()
    assert not found[~by_component].any()
    assert not found[:, ~by_component].any()
    dofs = (2 * nodes + np.arange(2)[:, None]).ravel()[by_component]
    expected = np.linalg.inv(k[np.ix_(dofs, dofs)])
    np.testing.assert_allclose(found[np.ix_(by_component, by_component)], expected, rtol=1e-8)


def test_random_loads_spare_held_components() -> None:
    free = ~held_components(2)
    loads = RandomLoads(np.arange(32), 4, 4, np.ones(2), 32, free)
    force = loads.draw(50, np.random.default_rng(0))
    assert not force[:, ~free].any()
    assert np.abs(force).max(axis=0)[free].min() > 0


def test_values_of_free_components_by_hand() -> None:
    """By nodes if all are held as wholes, else by components."""
    values = np.arange(12.0).reshape(2, 3, 2)
    nodes = np.array([True, False, True])
    expected = [[[0, 1], [4, 5]], [[6, 7], [10, 11]]]
    assert at_free(values, nodes).tolist() == expected
    assert at_free(values, np.repeat(nodes[:, None], 2, axis=1)).tolist() == expected
    single = np.array([[True, True], [False, True], [False, False]])
    assert at_free(values, single)[..., 0].tolist() == [[0, 1, 3], [6, 7, 9]]
