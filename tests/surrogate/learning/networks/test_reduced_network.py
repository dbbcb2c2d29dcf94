"""Reduced networks: their modes, their limits, and runs of every likelihood."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from torch import nn

from shared_schema.common.errors import InputError
from surrogate.learning.data.dataset import Dataset
from surrogate.learning.data.samples import Samples
from surrogate.learning.data.terms_on_grid import series_on_grid
from surrogate.learning.inference.export import export, load_exported
from surrogate.learning.inference.loading import load
from surrogate.learning.models.kinds import run_config
from surrogate.learning.models.reduced_model import ReducedModel
from surrogate.learning.networks.field_network import FieldNetwork
from surrogate.learning.networks.modes import leading_modes
from surrogate.learning.networks.reduced_network import ReducedNetwork
from surrogate.learning.optim.optimisers import is_hidden_kernel
from surrogate.learning.probabilistic.flipout import flipouts
from surrogate.mechanics.equilibrium.linear_response import LinearResponse, required
from tests.surrogate.resuming import assert_resumes, trained

SMALL = {"input_modes": 6, "output_modes": 8, "width": 16, "depth": 2}
KINDS: dict[str, dict[str, Any]] = {
    "d": {},
    "ensemble": {"ensemble": 3},
    "mle": {"likelihood": "maximum_likelihood"},
    "vb": {"likelihood": "variational_bayes", "variational": {"posterior_std": "gauss_newton"}},
    "series": {"network": {**SMALL, "series": [6, 3]}},
    "vb with a series": {
        "network": {**SMALL, "series": [6, 3]},
        "likelihood": "variational_bayes",
        "variational": {"posterior_std": "gauss_newton"},
    },
    "ensemble with a series": {"network": {**SMALL, "series": [6, 3]}, "ensemble": 2},
    "vb of the head": {"likelihood": "variational_bayes", "variational": {"layers": [2]}},
}


def reduced(**content: Any) -> ReducedModel:
    training: dict[str, Any] = {"epochs": 4, "batch_size": 8, "validation_fraction": 0.1}
    training |= {"optimiser": {"name": "muon", "learning_rate": 3e-3}}
    common = {"name": "a", "case": "beam2d", "model": "reduced", "network": SMALL}
    config = run_config({**common, "training": training, **content})
    assert isinstance(config, ReducedModel)
    return config


def fitted(config: ReducedModel, dataset: Dataset) -> tuple[FieldNetwork, ReducedNetwork]:
    field = config.build(dataset.geometry, dataset.info, dataset.material).eval()
    config.start_from_data(field, dataset, dataset.train)
    assert isinstance(field.network, ReducedNetwork)
    return field, field.network


def points(field: torch.Tensor, network: ReducedNetwork) -> torch.Tensor:
    return field.flatten(2)[:, :, network.points].flatten(1)


def test_it_starts_as_linear_elasticity(dataset: Dataset) -> None:
    field, _ = fitted(reduced(), dataset)
    assert isinstance(field.linear, LinearResponse)
    expected, _ = field.linear(dataset.test.force)
    torch.testing.assert_close(field(dataset.test.force).mean, expected)


def test_encoder_gives_the_coefficients_of_the_linear_response(dataset: Dataset) -> None:
    """(S Φ)ᵀ F = Φᵀ (S F), each over the square root of its root mean square."""
    field, network = fitted(reduced(), dataset)
    assert isinstance(field.linear, LinearResponse)
    a = points(dataset.train.force / field.force_scale, network) @ network.encoder.T
    linear = points(field.linear(dataset.train.force)[0], network)
    coefficients = linear @ leading_modes(linear, 6, seed=0).T
    expected = coefficients / coefficients.square().mean(dim=0).pow(0.25)
    expected *= (a.square().mean() / expected.square().mean()).sqrt()
    torch.testing.assert_close(a.abs(), expected.abs(), rtol=1e-3, atol=1e-4)  # signs are free
    assert float(a.square().mean()) == pytest.approx(1, rel=1e-3)


def test_it_starts_as_the_load_series(dataset: Dataset) -> None:
    """Before its training, the network is u₁ + u₂ + u₃, as far as the modes go."""
    response = LinearResponse(dataset.geometry, required(dataset.material), gradient=False)
    force = 3 * dataset.train.force
    second, third = series_on_grid(dataset, response, force)
    higher = second + third
    displacement = response(force)[0] + higher
    dataset = replace(dataset, train_in_memory=Samples(force, displacement))
    network = {**SMALL, "input_modes": 20, "output_modes": 40}
    errors = []
    for series in ([], [12], [12, 4], [20, 6]):
        field, _ = fitted(reduced(network={**network, "series": series}), dataset)
        with torch.no_grad():
            errors.append(float((field(force).mean - displacement).abs().mean()))
    assert errors[0] == pytest.approx(float(higher.abs().mean()))
    assert errors[1] < 0.5 * errors[0]
    assert errors[2] < 0.5 * errors[1]
    assert errors[3] < errors[2]


def test_modes_and_truncation_error(dataset: Dataset) -> None:
    """The modes are orthogonal; the rest has the root mean square `truncation`."""
    field, network = fitted(reduced(), dataset)
    gram = network.modes @ network.modes.T
    torch.testing.assert_close(
        gram, gram[0, 0] * torch.eye(8), rtol=0, atol=1e-4 * float(gram[0, 0])
    )
    correction = points(
        field.prepared(dataset.train).displacement / field.displacement_scale, network
    )
    basis = network.modes / gram[0, 0].sqrt()
    rest = correction - correction @ basis.T @ basis
    torch.testing.assert_close(
        rest.square().mean(dim=0).sqrt(), network.truncation, atol=1e-5, rtol=1e-3
    )
    singular = torch.linalg.svdvals(correction)
    expected = float(singular[8:].square().sum())
    assert float(rest.square().sum()) == pytest.approx(expected, rel=1e-2)


def test_standard_deviations_are_those_of_the_coefficients(dataset: Dataset) -> None:
    """σ_i² = Σ_k V_ik² σ_k² + truncation²."""
    field, network = fitted(reduced(likelihood="maximum_likelihood"), dataset)
    head = network.dense.head
    assert isinstance(head, nn.Linear)
    rho = torch.linspace(-1, 1, 8)
    with torch.no_grad():
        head.bias[8:] = rho
    std = field.learned(field.prepared(dataset.test).force).std
    assert std is not None
    sigma = torch.nn.functional.softplus(rho)
    expected = (network.modes * sigma[:, None]).square().sum(dim=0) + network.truncation.square()
    expected = expected.sqrt() * points(field.displacement_scale[None], network)[0]
    torch.testing.assert_close(points(std, network)[3], expected, rtol=1e-3, atol=0)


@pytest.mark.parametrize("kind", ["vb with a series", "ensemble with a series", "vb of the head"])
def test_k_and_k_epochs_are_2k(tmp_path: Path, dataset: Dataset, kind: str) -> None:
    assert_resumes(reduced(**KINDS[kind]), dataset, tmp_path, stop_after=2)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["mle", "vb with a series", "ensemble with a series"])
def test_saved_and_exported(tmp_path: Path, dataset: Dataset, kind: str) -> None:
    """The run folder alone predicts, and its ONNX file gives the same."""
    run = trained(reduced(**KINDS[kind]), dataset, tmp_path / "run")
    model = load(run.folder)
    force = np.random.default_rng(0).normal(size=(3, *dataset.geometry.coordinates.shape))
    force[:, dataset.geometry.clamped] = 0
    passes = 5 if model.is_stochastic else None
    expected = model.averaged_passes(force, passes=passes or 1)
    export(run.folder, tmp_path / "a.onnx", format="onnx", passes=passes)
    exported = load_exported(tmp_path / "a.onnx")(torch.from_numpy(force.astype(np.float32)))
    for name, array in expected.fields().items():
        if name in exported:
            scale = np.abs(array).max()
            np.testing.assert_allclose(exported[name].numpy(), array, atol=1e-4 * scale)
    assert "displacement" in exported


def test_it_learns_the_correction(tmp_path: Path, dataset: Dataset) -> None:
    """On its training samples the error falls far below that of linear elasticity."""
    optimiser = {"name": "muon", "learning_rate": 3e-3}
    training = {"epochs": 100, "batch_size": 8, "loss": "mae", "optimiser": optimiser}
    config = reduced(training=training, network={**SMALL, "output_modes": 24, "width": 64})
    run = trained(config, dataset, tmp_path / "run")
    linear, _ = fitted(reduced(), dataset)
    start = linear.prepared(dataset.train).displacement.abs().mean()
    network = load(run.folder).network
    with torch.no_grad():
        error = (network(dataset.train.force).mean - dataset.train.displacement).abs().mean()
    assert error < 0.2 * start


def test_random_layers_and_layers_of_muon(dataset: Dataset) -> None:
    config = reduced(likelihood="variational_bayes", variational={"layers": [1, 2]})
    _, network = fitted(config, dataset)
    assert len(list(flipouts(network))) == 2
    hidden = [name for name, p in network.named_parameters() if is_hidden_kernel(name, p)]
    assert hidden == ["dense.hidden.0.kernel.mean"]


@pytest.mark.parametrize(
    ("content", "part"),
    [
        ({"network": {**SMALL, "width": 0}}, "key 'network.width' = 0"),
        (
            {"network": {**SMALL, "series": [7]}},
            "'series' = [7]: expected 6 modes at most, the number of 'input_modes'",
        ),
        ({"network": {"levels": 3}}, "unknown key 'network.levels'"),
        (
            {"likelihood": "variational_bayes", "variational": {"layers": [3]}},
            "expected layers of the network, 0 to 2",
        ),
        (
            {"likelihood": "variational_bayes", "variational": {"convolutions": [1]}},
            "unknown key 'variational.convolutions'",
        ),
    ],
)
def test_wrong_keys_are_named(content: dict[str, Any], part: str) -> None:
    with pytest.raises(InputError) as error:
        reduced(**content)
    assert part in str(error.value)


def test_more_modes_than_samples(dataset: Dataset) -> None:
    config = reduced(network={**SMALL, "output_modes": 49})
    with pytest.raises(InputError, match=r"'network.output_modes' = 49: expected 48 at most"):
        config.require_suitable(dataset, dataset.train)
