"""Proper orthogonal decomposition, and complete runs of it."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor

from shared_schema.common.errors import InputError
from surrogate.contrib.pod import GaussianProcessConfig, PODNetwork, RidgeConfig
from surrogate.learning.data.dataset import Dataset
from surrogate.learning.data.samples import Samples
from surrogate.learning.evaluation.run_evaluation import evaluate
from surrogate.learning.inference.loading import load
from surrogate.learning.inference.surrogate import Surrogate
from surrogate.learning.models.kinds import run_config
from surrogate.learning.models.model import Model
from surrogate.learning.models.training_config import SplitConfig
from surrogate.learning.runs.folder import RunFolder
from surrogate.learning.training.loop import train
from surrogate.mechanics.equilibrium.linear_response import LinearResponse

CPU = torch.device("cpu")
CONFIGS: dict[str, tuple[str, dict[str, Any]]] = {
    "ridge": ("ridge", {"degree": 3}),
    "gp": ("gp", {}),
    "modal-gp": ("gp", {"inputs": "linear_modes", "input_modes": 8, "tuned_modes": 4}),
}
FREE = torch.ones(5, 3, dtype=torch.bool)
FREE[0] = False


def low_rank(count: int, rank: int) -> tuple[Tensor, Tensor]:
    """Return forces at one edge, and u = ū + Σ_k (w_k · f) φ_k, zero at clamped nodes."""
    rng = torch.Generator().manual_seed(0)
    force = torch.zeros(count, 2, 5, 3)
    force[:, :, 1:, 2] = torch.rand(count, 2, 4, generator=rng) * 2 - 1
    weights = torch.randn(8, rank, generator=rng)
    modes = torch.randn(rank, 2, 5, 3, generator=rng) * FREE
    mean = torch.randn(2, 5, 3, generator=rng) * FREE
    coefficients = force[:, :, 1:, 2].flatten(1) @ weights
    return force, mean + torch.einsum("nr,r...->n...", coefficients, modes)


def test_data_of_rank_r_is_exact() -> None:
    """The fit finds r modes, which reproduce linear data, also for new forces."""
    force, displacement = low_rank(60, 3)
    network = PODNetwork(RidgeConfig(energy=1 - 1e-10, degree=1, penalty=1e-12), FREE)
    network.fit(force[:40], displacement[:40], seed=0)
    assert network.modes.shape == (3, 2 * 12)
    gram = network.modes @ network.modes.T
    torch.testing.assert_close(gram, torch.eye(3).double(), rtol=0, atol=1e-12)
    predicted, std = network(force)
    torch.testing.assert_close(predicted, displacement, rtol=0, atol=1e-5)
    assert not predicted[:, :, 0].any()
    assert std is None
    assert network.loaded.tolist() == [5, 8, 11, 14]


def test_truncation_is_the_best_of_its_rank() -> None:
    """One mode has the squared error Σ_{k > 1} s_k² of the singular values s (Eckart–Young)."""
    force, displacement = low_rank(60, 3)
    network = PODNetwork(RidgeConfig(rank=1), FREE)
    network.fit(force, displacement, seed=0)
    snapshots = displacement.flatten(2)[:, :, FREE.flatten()].flatten(1).double()
    values = torch.linalg.svdvals(snapshots - snapshots.mean(dim=0))
    left_out = network.truncation.square().sum() * 60
    assert left_out.item() == pytest.approx(values[1:].square().sum().item(), rel=1e-6)


def test_energy_gives_the_rank() -> None:
    """The rank is the smallest r with Σ_{k ≤ r} s_k² / Σ s_k² above the energy."""
    force, displacement = low_rank(60, 6)
    snapshots = displacement.flatten(2)[:, :, FREE.flatten()].flatten(1).double()
    values = torch.linalg.svdvals(snapshots - snapshots.mean(dim=0)).square()
    held = values.cumsum(dim=0) / values.sum()
    for energy in (0.5, 0.8, 0.99):
        network = PODNetwork(RidgeConfig(energy=energy), FREE)
        network.fit(force, displacement, seed=0)
        assert len(network.modes) == int((held < energy).sum()) + 1


def test_spread_through_the_modes_by_hand() -> None:
    """σ_i² = Σ_k φ_ki² σ_k² + truncation²; σ_k comes from the Gaussian process."""
    force, displacement = low_rank(50, 4)
    network = PODNetwork(GaussianProcessConfig(regression="gp", rank=2), FREE)
    network.fit(force[:30], displacement[:30], seed=0)
    _, std = network(force[30:])
    _, spread = network.regression(force[30:].flatten(2)[:, :, network.loaded].double())
    assert spread is not None
    variance = spread**2 @ network.modes**2 + network.truncation**2
    expected = variance.sqrt().reshape(20, 2, 12)
    torch.testing.assert_close(
        std.flatten(2)[:, :, FREE.flatten()].double(), expected, rtol=1e-5, atol=2e-6
    )
    assert not std[:, :, 0].any()


def config_with(regression: str, **pod: Any) -> Model:
    return run_config(
        {
            "name": regression,
            "case": "beam2d",
            "model": "pod",
            "likelihood": "maximum_likelihood" if regression == "gp" else "deterministic",
            "pod": {"regression": regression, **pod},
            "displacement_scale": "node",
            "training": {"validation_fraction": 0.1},
        }
    )


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory, dataset: Dataset) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("runs")
    for name, (regression, keys) in CONFIGS.items():
        train(config_with(regression, **keys), dataset, folder / name, device="cpu")
    return {name: folder / name for name in CONFIGS}


@pytest.mark.parametrize("regression", CONFIGS)
def test_one_line_of_measures_and_no_epochs(
    runs: dict[str, Path], dataset: Dataset, regression: str
) -> None:
    run = RunFolder(runs[regression])
    (line,) = run.metric_lines()
    assert line["epoch"] == 0
    errors = {"validation_loss", "validation_error", "validation_relative_error"}
    assert set(line) == {"epoch", "seconds"} | errors
    assert not run.checkpoint.exists()
    before = run.model.stat().st_mtime_ns
    train(run.description().run, dataset, run.folder, device="cpu")
    assert run.model.stat().st_mtime_ns == before


@pytest.mark.parametrize("regression", ["ridge", "gp"])
def test_better_than_the_mean_field(
    runs: dict[str, Path], data: Path, dataset: Dataset, regression: str
) -> None:
    """A fit to 43 samples has a smaller error than the prediction of zero displacement."""
    evaluate(runs[regression], data).write()
    content = json.loads((runs[regression] / "evaluation.json").read_text())
    rest = np.abs(dataset.nodal_test.displacement).mean()
    assert content["test"]["mean_error"] < 0.3 * rest
    assert content["epochs"] == 0
    assert not (runs[regression] / "figures" / "loss.png").exists()
    assert ("uncertainty" in content) == (regression == "gp")


def test_spread_of_a_gaussian_process_is_epistemic(runs: dict[str, Path], dataset: Dataset) -> None:
    """The standard deviation grows away from the data and is positive at every free node."""
    surrogate: Surrogate = load(runs["gp"])
    force = dataset.nodal_test.force
    near, far = (surrogate.predict_distribution(factor * force) for factor in (1.0, 20.0))
    free = ~surrogate.geometry.clamped
    assert not near.std_aleatoric.any()
    assert (near.std_epistemic[:, free] > 0).all()
    assert near.std[:, free].mean() < 0.5 * far.std[:, free].mean()


def test_inputs_are_coefficients_of_the_linear_response(tmp_path: Path, dataset: Dataset) -> None:
    """With all modes, the coefficients have the norm of u_lin = K⁻¹f, up to a common unit.

    48 training samples span a space of 48 modes at most. The inputs are the coefficients divided
    by the square roots of their root mean squares, which are then in proportion to the root mean
    squares of the inputs. The root mean square of all inputs is 1.
    """
    config = config_with("gp", inputs="linear_modes", input_modes=48).model_copy(
        update={"training": SplitConfig()}
    )
    train(config, dataset, tmp_path / "run", device="cpu")
    field = load(tmp_path / "run").network
    pod, response = field.network, field.linear
    assert isinstance(pod, PODNetwork)
    assert isinstance(response, LinearResponse)
    force = dataset.train.force
    inputs = pod._inputs(force / field.force_scale)
    coefficients = inputs * inputs.square().mean(dim=0).sqrt()
    norms = response(force)[0].flatten(1).double().norm(dim=1)
    torch.testing.assert_close(
        coefficients.norm(dim=1) / norms,
        (coefficients.norm() / norms.norm()).expand(48),
        rtol=1e-4,
        atol=0,
    )
    assert inputs.square().mean().item() == pytest.approx(1, rel=1e-4)


def test_better_than_the_linear_response(
    runs: dict[str, Path], tmp_path: Path, dataset: Dataset
) -> None:
    """Of displacements (1 + ‖u_lin‖ / a) u_lin, 43 samples find more than half of the rest."""
    response = load(runs["modal-gp"]).network.linear
    assert isinstance(response, LinearResponse)

    def solve(samples: Samples) -> Samples:
        linear = response(samples.force)[0]
        norm = linear.flatten(1).norm(dim=1).reshape(-1, 1, 1, 1)
        return Samples(samples.force, linear * (1 + 0.1 * norm / unit))

    unit = response(dataset.train.force)[0].flatten(1).norm(dim=1).mean()
    elastic = replace(dataset, train_in_memory=solve(dataset.train), test=solve(dataset.test))
    train(
        config_with(CONFIGS["modal-gp"][0], **CONFIGS["modal-gp"][1]),
        elastic,
        tmp_path / "run",
        device="cpu",
    )
    predicted = load(tmp_path / "run").network(elastic.test.force).mean
    linear = response(elastic.test.force)[0]
    left = (predicted - elastic.test.displacement).abs().mean()
    assert left < 0.5 * (linear - elastic.test.displacement).abs().mean()


def test_linear_response_is_added_far_from_the_samples(runs: dict[str, Path]) -> None:
    """Where the process knows nothing, it predicts the mean of the corrections, u − u_lin."""
    surrogate = load(runs["modal-gp"])
    response = surrogate.network.linear
    assert isinstance(response, LinearResponse)
    force = np.zeros((1, *surrogate.geometry.coordinates.shape))
    force[0, -1, 1] = 1e4
    grid = torch.from_numpy(surrogate.geometry.grid.to_grid(force)).float()
    linear = surrogate.geometry.grid.to_nodes(response(grid)[0].numpy())
    predicted = surrogate.predict_distribution(force).mean
    np.testing.assert_allclose(predicted, linear, rtol=0, atol=1e-3 * np.abs(linear).max())


def test_more_linear_modes_than_samples_are_refused(tmp_path: Path, dataset: Dataset) -> None:
    run = RunFolder(tmp_path / "run")
    config = config_with("gp", inputs="linear_modes")
    with pytest.raises(InputError, match=r"'pod\.input_modes' = 48: expected 43 at most"):
        train(config, dataset, run.folder, device="cpu")
    assert not run.folder.exists()


def test_rank_beyond_the_data_is_refused(tmp_path: Path, dataset: Dataset) -> None:
    """The largest rank is 43, from 43 samples (of 48) and 56 degrees of freedom."""
    run = RunFolder(tmp_path / "run")
    with pytest.raises(InputError, match=r"'pod\.rank' = 44: expected 43 at most"):
        train(config_with("ridge", rank=44), dataset, run.folder, device="cpu")
    assert not run.folder.exists()
