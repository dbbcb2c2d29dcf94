"""The linear response against a direct solve, and networks that are given it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from torch import nn

from shared_schema.common.errors import InputError
from shared_schema.grid import Grid
from shared_schema.materials import NeoHookean
from surrogate.learning.data.dataset import Dataset
from surrogate.learning.inference.export import export, load_exported
from surrogate.learning.inference.loading import load
from surrogate.learning.models.unet_model import UNetModel
from surrogate.mechanics.equilibrium.linear_response import LinearResponse, nodal_gradient
from tests.surrogate.plane_strain import plane_strain_stiffness
from tests.surrogate.resuming import trained
from tests.surrogate.unet_configs import unet_config

MECHANICS = {"inputs": ["force", "linear_gradient"], "skip": "linear"}


MATERIAL = NeoHookean(young_modulus=500, poisson_ratio=0.4)


@pytest.fixture(scope="module")
def stiff(dataset: Dataset) -> Dataset:
    """The dataset, of the material of `plane_strain_stiffness`."""
    assert dataset.material == MATERIAL
    return dataset


@pytest.fixture(scope="module")
def response(stiff: Dataset) -> LinearResponse:
    found = LinearResponse(stiff.geometry, MATERIAL)
    found.scale_gradient(stiff.train.force)
    return found


def solve(dataset: Dataset, force: np.ndarray) -> np.ndarray:
    """Nodal displacements of linear elasticity, by a dense solve: (N, n_nodes, d)."""
    free = np.flatnonzero(~dataset.geometry.clamped)
    dofs = (2 * free[:, None] + np.arange(2)).ravel()
    k = plane_strain_stiffness(dataset.geometry)[np.ix_(dofs, dofs)]
    u = np.zeros((len(force), dataset.geometry.coordinates.size))
    u[:, dofs] = np.linalg.solve(k, force.reshape(len(force), -1)[:, dofs].T).T
    return u.reshape(force.shape)


def random_forces(dataset: Dataset, count: int) -> np.ndarray:
    return np.random.default_rng(0).normal(size=(count, *dataset.geometry.coordinates.shape))


def test_response_to_forces_on_all_nodes(stiff: Dataset, response: LinearResponse) -> None:
    """Forces on clamped nodes move nothing."""
    force, grid = random_forces(stiff, 5), stiff.geometry.grid
    expected = solve(stiff, force)
    displacement, _ = response(torch.from_numpy(grid.to_grid(force).astype(np.float32)))
    found = grid.to_nodes(displacement.numpy())
    np.testing.assert_allclose(found, expected, atol=2e-6 * np.abs(expected).max())
    assert not found[:, stiff.geometry.clamped].any()


def test_gradient_of_the_response(stiff: Dataset, response: LinearResponse) -> None:
    """Channel i + d j is ∂u_i / ∂x_j over its root mean square under the training forces."""
    geometry, force = stiff.geometry, random_forces(stiff, 3)
    u = solve(stiff, force)
    operators = nodal_gradient(geometry.coordinates, geometry.cells, geometry.cell_type)
    expected = np.concatenate([np.stack([o @ s for s in u]) for o in operators], axis=-1)
    grid = geometry.grid
    _, gradient = response(torch.from_numpy(grid.to_grid(force).astype(np.float32)))
    found = grid.to_nodes(gradient.numpy()) * float(response.gradient_rms)
    np.testing.assert_allclose(found, expected, atol=2e-6 * np.abs(expected).max())
    _, training = response(stiff.train.force)
    assert training.square().mean().sqrt().item() == pytest.approx(1.0, rel=1e-5)


def test_embedded_grid_of_the_nodes(stiff: Dataset, response: LinearResponse) -> None:
    """A grid that is embedded, but whose operators are those of the nodes, gives the same."""
    same = stiff.geometry.grid
    twice = [np.concatenate((a, a), axis=-1) for a in (same.sources, same.points)]
    once = [
        np.concatenate((w, np.zeros_like(w)), axis=-1)
        for w in (same.source_weights, same.point_weights)
    ]
    grid = Grid(twice[0], once[0], twice[1], once[1])
    assert not grid.points_are_nodes
    embedded = LinearResponse(replace(stiff.geometry, grid=grid), MATERIAL)
    embedded.scale_gradient(stiff.train.force)
    for found, expected in zip(embedded(stiff.test.force), response(stiff.test.force), strict=True):
        torch.testing.assert_close(found, expected)


@pytest.mark.parametrize("ensemble", [1, 2])
def test_a_network_of_zeros_is_linear_elasticity(stiff: Dataset, ensemble: int) -> None:
    config = unet_config(
        case="beam2d", network={"levels": 1, "channels": 2, **MECHANICS}, ensemble=ensemble
    )
    network = config.build(stiff.geometry, stiff.info, MATERIAL)
    config.start_from_data(network, stiff, stiff.train)
    for name, parameter in network.named_parameters():
        if "head" in name:
            nn.init.zeros_(parameter)
    mean, std = network.eval()(stiff.test.force)
    assert std is None
    assert isinstance(network.linear, LinearResponse)
    expected, _ = network.linear(stiff.test.force)
    torch.testing.assert_close(mean, expected.repeat(ensemble, 1, 1, 1))


@pytest.mark.parametrize("scale", ["global", "node"])
def test_scale_is_that_of_the_correction(stiff: Dataset, scale: str) -> None:
    """Root mean square of u − u_lin: over all free components, or one by one."""
    content: dict[str, Any] = {"case": "beam2d", "displacement_scale": scale}
    config = unet_config(network={"levels": 1, "channels": 2, **MECHANICS}, **content)
    network = config.build(stiff.geometry, stiff.info, MATERIAL)
    config.start_from_data(network, stiff, stiff.train)
    assert isinstance(network.linear, LinearResponse)
    rest = stiff.train.displacement - network.linear(stiff.train.force)[0]
    free = torch.from_numpy(stiff.geometry.free_mask)
    squares = rest.square().mean(dim=0)[:, free]
    expected = squares.sqrt() if scale == "node" else squares.mean().sqrt().expand_as(squares)
    torch.testing.assert_close(network.displacement_scale[:, free], expected)


LIKELIHOODS: list[dict[str, Any]] = [
    {},
    {"likelihood": "maximum_likelihood"},
    {"likelihood": "variational_bayes", "variational": {}},
]


def mechanics_config(make_config: Callable[..., UNetModel], **options: Any) -> UNetModel:
    config = make_config(epochs=4, **options)
    content = config.plain()
    content["network"] |= MECHANICS
    return unet_config(**{key: value for key, value in content.items() if value is not None})


@pytest.mark.slow
@pytest.mark.parametrize("options", LIKELIHOODS[::2], ids=["d", "vb"])
def test_saved_and_exported(
    tmp_path: Path, stiff: Dataset, make_config: Callable[..., UNetModel], options: dict[str, Any]
) -> None:
    """The run folder alone predicts, and its ONNX file gives the same."""
    run = trained(mechanics_config(make_config, **options), stiff, tmp_path / "run")
    model = load(run.folder)
    force = random_forces(stiff, 3) * ~stiff.geometry.clamped[:, None]
    expected = model.averaged_passes(force, passes=1) if not options else None
    export(run.folder, tmp_path / "a.onnx", format="onnx")
    exported = load_exported(tmp_path / "a.onnx")(torch.from_numpy(force.astype(np.float32)))
    if expected is not None:
        found = exported["displacement"].numpy()
        np.testing.assert_allclose(found, expected.mean, atol=1e-5 * np.abs(found).max())
    assert {"displacement", *(["std"] if options else [])} <= set(exported)


def test_it_is_wrong_input_without_material(stiff: Dataset) -> None:
    config = unet_config(case="beam2d", network={"levels": 1, "channels": 2, **MECHANICS})
    with pytest.raises(InputError, match="expects the material of the body"):
        config.build(stiff.geometry, stiff.info)


def test_prepared_samples_lead_to_the_same_prediction(stiff: Dataset) -> None:
    """What a training computes once, and what it adds in every step, are the whole network."""
    config = unet_config(case="beam2d", network={"levels": 1, "channels": 2, **MECHANICS})
    network = config.build(stiff.geometry, stiff.info, MATERIAL).eval()
    config.start_from_data(network, stiff, stiff.train)
    prepared = network.prepared(stiff.test)
    learned = network.learned(prepared.force).mean
    expected = network(stiff.test.force).mean - stiff.test.displacement
    torch.testing.assert_close(learned - prepared.displacement, expected, rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize(
    ("network", "part"),
    [
        ({"inputs": []}, "key 'network.inputs'"),
        ({"inputs": ["force", "force"]}, "inputs = ['force', 'force']: expected each once"),
        ({"inputs": ["strain"]}, "key 'network.inputs.0' = 'strain'"),
        ({"skip": "all"}, "key 'network.skip' = 'all'"),
        (
            {"inputs": ["linear_gradient"], "force_transforms": ["asinh"]},
            "force_transforms = ['asinh']: expected with input 'force'",
        ),
    ],
)
def test_wrong_keys_are_named(network: dict[str, Any], part: str) -> None:
    with pytest.raises(InputError) as error:
        unet_config(network=network)
    assert part in str(error.value)
