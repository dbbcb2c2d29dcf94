"""The linear surrogate compared with linear finite elements, assembled here for a small mesh."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from shared_schema.common.errors import InputError
from shared_schema.grid import Grid
from shared_schema.stiffness import stiffness_problems
from surrogate.learning.data.dataset import Dataset
from surrogate.learning.inference.loading import load
from surrogate.learning.inference.surrogate import Surrogate
from surrogate.learning.models.kinds import run_config
from surrogate.learning.models.model import Model
from surrogate.learning.networks.field_network import parameter_count
from surrogate.learning.networks.linear_map import LinearMap, compliance_of
from surrogate.learning.runs.description import describe
from surrogate.learning.runs.folder import RunFolder
from surrogate.learning.training.loop import train
from tests.surrogate.plane_strain import plane_strain_stiffness, sparse

CPU = torch.device("cpu")


@pytest.fixture(scope="module")
def stiffness(dataset: Dataset) -> np.ndarray:
    return plane_strain_stiffness(dataset.geometry)


@pytest.fixture(scope="module")
def with_stiffness(dataset: Dataset, stiffness: np.ndarray) -> Dataset:
    found = sparse(stiffness)
    assert stiffness_problems(found, 64) == []
    return replace(dataset, stiffness=found)


def linear_config(**changes: Any) -> Model:
    content = {
        "name": "linear",
        "case": "beam2d",
        "model": "linear",
        "displacement_scale": "node",
        "training": {"epochs": 4, "batch_size": 16, "optimiser": {"learning_rate": 1e-3}},
    }
    return run_config({**content, **changes})


@pytest.mark.parametrize("scale", ["global", "node"])
@pytest.mark.parametrize("order", ["preferred", "other"])
def test_untrained_it_is_linear_elasticity(
    with_stiffness: Dataset, stiffness: np.ndarray, scale: str, order: str
) -> None:
    """u = K⁻¹ f at every free node, to 1e-4; forces at clamped nodes have no effect."""
    dataset = with_stiffness
    if order == "other":
        nodes = np.random.default_rng(0).permutation(32)
        grid = Grid.from_coordinates(dataset.geometry.coordinates).reordered(nodes)
        dataset = replace(dataset, geometry=replace(dataset.geometry, grid=grid))
    config = linear_config(displacement_scale=scale)
    description = describe(config, dataset)
    network = description.run.build(dataset.geometry, dataset.info)
    config.start_from_data(network, dataset, dataset.train)
    force = np.random.default_rng(1).normal(size=(5, 32, 2)) * (np.arange(32) > 3)[:, None]
    found = Surrogate(network, dataset.geometry, description).predict(force)
    free = np.repeat(~dataset.geometry.clamped, 2)
    expected = np.zeros((5, 64))
    loads = force.reshape(5, 64)[:, free]
    expected[:, free] = np.linalg.solve(stiffness[np.ix_(free, free)], loads.T).T
    error = np.linalg.norm(found.reshape(5, 64) - expected, axis=1)
    assert (error < 1e-4 * np.linalg.norm(expected, axis=1)).all()
    assert parameter_count(network) == 56**2


def test_compliance_is_symmetric_and_positive(with_stiffness: Dataset) -> None:
    geometry = with_stiffness.geometry
    assert geometry.grid.points_are_nodes
    assert with_stiffness.stiffness is not None
    grid = geometry.grid
    nodes = grid.node_at[grid.moved_by(~geometry.clamped)]
    compliance = compliance_of(with_stiffness.stiffness, nodes, geometry.free)
    torch.testing.assert_close(compliance, compliance.T, rtol=1e-9, atol=1e-12)
    assert torch.linalg.eigvalsh(compliance).min() > 0


def test_scaled_compliance_by_hand() -> None:
    """Two free points with one component have W_ij = C_ij · 2 N / s_i with s = 4 and 8 m."""
    free = torch.tensor([[False, True], [True, False]])
    linear = LinearMap(1, free)
    compliance = torch.tensor([[1.0, 2.0], [3.0, 4.0]]).double()
    linear.start_at(compliance, torch.tensor(2.0), torch.tensor([[[9.0, 4.0], [8.0, 9.0]]]))
    assert linear.weight.tolist() == [[0.5, 1.0], [0.75, 1.0]]
    found = linear(torch.tensor([[[[7.0, 1.0], [10.0, 7.0]]]]))
    assert found.tolist() == [[[[0.0, 10.5], [10.75, 0.0]]]]


def test_trained_by_the_ordinary_loop(tmp_path: Path, with_stiffness: Dataset) -> None:
    """The loss falls from that of linear elasticity; a resume from a checkpoint is exact."""
    optimiser = {"learning_rate": 1e-3}
    training = {"epochs": 30, "batch_size": 16, "loss": "mae", "optimiser": optimiser}
    config = linear_config(training=training)
    whole, parts = RunFolder(tmp_path / "whole"), RunFolder(tmp_path / "parts")
    train(config, with_stiffness, whole.folder, device="cpu")
    train(config, with_stiffness, parts.folder, device="cpu", stop_after=9)
    train(config, with_stiffness, parts.folder, device="cpu")
    assert whole.model.read_bytes() == parts.model.read_bytes()
    losses = [line["train_loss"] for line in whole.metric_lines()]
    assert losses[-1] < 0.95 * losses[0]
    force = with_stiffness.nodal_test.force
    one, twice = (
        load(tmp_path / "whole").predict(force),
        load(tmp_path / "whole").predict(2 * force),
    )
    np.testing.assert_allclose(twice, 2 * one, atol=1e-5)
    assert not load(tmp_path / "whole").is_probabilistic


def test_dataset_without_stiffness_is_refused(tmp_path: Path, dataset: Dataset) -> None:
    run = RunFolder(tmp_path / "run")
    with pytest.raises(InputError, match="'model' = 'linear': the dataset has no stiffness; make"):
        train(linear_config(), dataset, run.folder, device="cpu")
    assert not run.folder.exists()


def test_embedded_grid_is_refused(tmp_path: Path, with_stiffness: Dataset) -> None:
    """Its points are not nodes, so K⁻¹ does not map forces to displacements on the grid."""
    points = np.arange(32)[:, None]
    sources = np.repeat(points.reshape(8, 4, 1), 2, axis=2)
    grid = Grid(sources, np.full((8, 4, 2), 0.5), points, np.ones((32, 1)))
    embedded = replace(with_stiffness, geometry=replace(with_stiffness.geometry, grid=grid))
    run = RunFolder(tmp_path / "run")
    with pytest.raises(InputError, match="'model' = 'linear': the dataset's grid is embedded"):
        train(linear_config(), embedded, run.folder, device="cpu")
    assert not run.folder.exists()
