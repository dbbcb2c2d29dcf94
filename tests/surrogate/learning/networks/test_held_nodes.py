"""Supports of networks on embedded grids are held exactly, in every prediction."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from scipy.sparse import csc_array

from surrogate.learning.data.dataset import Dataset
from surrogate.learning.data.joined_dataset import read_dataset
from surrogate.learning.inference.export import export
from surrogate.learning.inference.loading import load
from surrogate.learning.inference.surrogate import Surrogate
from surrogate.learning.networks.nodal_network import Extension, HeldNodes, screened_laplacian
from surrogate.mechanics.equilibrium.out_of_balance import Equilibrium
from tests.surrogate.embedded_box import on_points
from tests.surrogate.learning.data.test_embedded_dataset import embedded
from tests.surrogate.learning.inference.test_export import run_file
from tests.surrogate.learning.inference.test_export import untrained as saved
from tests.surrogate.learning.inference.test_predictor import MECHANICS, untrained


@pytest.fixture(scope="module")
def coarse(data: Path, tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    """The 8 × 4 nodes on a grid of 6 × 3 points."""
    return read_dataset(embedded(data, tmp_path_factory.mktemp("held") / "data", on_points(6, 3)))


def supported(dataset: Dataset, single: bool = False) -> Dataset:
    """Two columns of nodes are held, the second between points of the grid."""
    geometry = dataset.geometry
    clamped, held = geometry.coordinates[:, 0] <= 0.5, None
    if single:
        held = np.repeat(clamped[:, None], geometry.dimension, axis=1)
        held[geometry.coordinates[:, 1] == 0, 1] = True  # a roller along the lower edge
    loadable = geometry.loadable & ~clamped
    body = replace(geometry, clamped=clamped, single=held, loadable=loadable)
    return replace(dataset, geometry=body)


def loads(model: Surrogate) -> np.ndarray:
    shape = (4, *model.geometry.coordinates.shape)
    return np.random.default_rng(0).normal(size=shape) * ~model.geometry.held


KINDS: dict[str, dict[str, Any]] = {
    "plain": {},
    "linear response": {"network": MECHANICS},
    "reduced": {"model": "reduced"},
    "maximum likelihood": {"likelihood": "maximum_likelihood", "network": MECHANICS},
    "variational Bayes": {
        "likelihood": "variational_bayes",
        "variational": {"initial_std": 0.1},
        "ensemble": 2,
    },
}


@pytest.mark.parametrize("single", [False, True], ids=["clamped", "rollers"])
@pytest.mark.parametrize("kind", KINDS)
def test_held_in_every_prediction(coarse: Dataset, kind: str, single: bool) -> None:
    """Means, single passes and standard deviations, of one load and of several, are 0 there."""
    if single and KINDS[kind].get("likelihood", "deterministic") != "deterministic":
        pytest.skip("covered by the clamped body")
    body = supported(coarse, single)
    model = untrained(body, **KINDS[kind])
    held, forces = model.geometry.held, loads(model)
    together = model.predict(forces)
    model.predictor.passes.draw(0, range(5))
    with torch.inference_mode():
        passes = model.predictor.network(
            torch.from_numpy(forces).float(), 5 if model.is_stochastic else 1
        )
    fields = [together, model.predict(forces[0])[None], passes.mean[0].numpy()]
    if model.is_probabilistic:
        found = model.predict_distribution(forces, passes=5)
        fields += [found.mean, found.std, found.std_epistemic, found.std_aleatoric]
        assert (found.std[:, ~held] > 0).all()
    for field in fields:
        assert not field[:, held].any()
    assert together[:, ~held].any()
    one = np.stack([model.predict(force) for force in forces])
    np.testing.assert_allclose(one, together, rtol=0, atol=1e-5 * np.abs(together).max())


@pytest.mark.slow
def test_held_in_exported_files(coarse: Dataset, tmp_path: Path) -> None:
    geometry = supported(coarse).geometry
    run = saved(tmp_path / "run", coarse, "maximum_likelihood", geometry)
    export(run, tmp_path / "model.pt2", format="pt2")
    model = load(run)
    fields = run_file(tmp_path / "model.pt2", loads(model))
    expected = model.predict_distribution(loads(model))
    np.testing.assert_allclose(fields["displacement"], expected.mean, rtol=0, atol=1e-5)
    assert not any(field[:, geometry.held].any() for field in fields.values())


def test_a_field_that_is_right_stays(coarse: Dataset) -> None:
    """A field that vanishes at the supports is not changed."""
    geometry = supported(coarse).geometry
    field = torch.from_numpy(np.where(geometry.held, 0.0, geometry.coordinates)).float().T[None]
    torch.testing.assert_close(HeldNodes(geometry)(field), field, rtol=0, atol=0)


def test_extension_along_a_chain() -> None:
    """On a chain of nodes one step h apart errors decay by r, with r + 1/r = 2 + h²/ℓ²."""
    nodes, length = 40, 1.5
    x = np.arange(nodes, dtype=float)[:, None]
    cells = np.stack([np.arange(nodes - 1), np.arange(1, nodes)], axis=1)
    laplacian, screening = screened_laplacian(x, cells, length)
    found = Extension(csc_array(laplacian + screening), np.arange(nodes) == 0)
    ratio = 1 + 0.5 / length**2
    decay = ratio - math.sqrt(ratio**2 - 1)
    rows = np.count_nonzero(decay ** np.arange(1, nodes) > 1e-3)
    expected = decay ** np.arange(1, rows + 1)
    np.testing.assert_allclose(found.near[:, 0], expected, rtol=1e-5)
    field = found(torch.ones(1, 1, nodes))[0, 0].numpy()
    assert field[0] == 0
    np.testing.assert_allclose(field[1 : rows + 1], 1 - expected, rtol=1e-5)
    assert (field[rows + 1 :] == 1).all()


def test_the_linear_response_is_exact(coarse: Dataset) -> None:
    """Without a network, what is predicted is K⁻¹ AᵀBᵀ f at the nodes, not what a grid holds."""
    body = supported(coarse)
    model = untrained(body, network=MECHANICS)
    for weights in model.network.network.parameters():
        torch.nn.init.zeros_(weights)
    forces, grid = loads(model), body.geometry.grid
    to_grid = np.zeros((grid.mask.size, grid.nodes))  # A
    sources = grid.sources.reshape(len(to_grid), -1)
    np.put_along_axis(to_grid, sources, grid.source_weights.reshape(sources.shape), axis=1)
    on_grid = grid.forces_to_grid(forces)
    spread = (on_grid.reshape(*on_grid.shape[:2], -1) @ to_grid).swapaxes(1, 2)
    expected = Equilibrium(model.geometry, body.material).linear_response(spread)
    found = model.predict(forces)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-5 * np.abs(expected).max())
    np.testing.assert_allclose(model.predict(forces[0]), found[0], atol=1e-5 * found.max())
