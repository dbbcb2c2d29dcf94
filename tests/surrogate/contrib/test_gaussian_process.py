from __future__ import annotations

import numpy as np
import pytest
import torch
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel
from torch import Tensor

from surrogate.contrib.regressions import GaussianProcess


def data(count: int, seed: int = 0) -> tuple[Tensor, Tensor]:
    """Return forces (N, 2, 3) and three smooth outputs of different magnitude."""
    generator = torch.Generator().manual_seed(seed)
    force = torch.rand(count, 2, 3, generator=generator, dtype=torch.float64) * 2 - 1
    x = force.flatten(1)
    outputs = [torch.sin(2 * x[:, 0]) + 5, 100 * x[:, 1] * x[:, 2], 1e-3 * x.square().sum(dim=1)]
    return force, torch.stack(outputs, dim=1)


def fitted(samples: int, force: Tensor, outputs: Tensor) -> GaussianProcess:
    model = GaussianProcess(samples)
    model.fit(force, outputs, torch.Generator().manual_seed(0))
    return model


def test_against_scikit_learn() -> None:
    """Mean and standard deviation equal those of scikit-learn, to 1e-5 of the outputs."""
    force, outputs = data(120)
    model = fitted(1000, force, outputs)
    start = ConstantKernel(10.0, (1e-3, 1e5)) * RBF(1.0, (1e-2, 1e3)) + WhiteKernel(
        1e-4, (1e-8, 1.0)
    )
    order = torch.randperm(120, generator=torch.Generator().manual_seed(0))
    theirs = GaussianProcessRegressor(start, normalize_y=True)
    theirs.fit(force.flatten(1)[order].numpy(), outputs[order].numpy())
    new = data(30, seed=1)[0]
    mean, std = model(new)
    expected_mean, expected_std = theirs.predict(new.flatten(1).numpy(), return_std=True)
    size = outputs.std(dim=0).numpy()
    np.testing.assert_allclose(mean.numpy() / size, expected_mean / size, atol=1e-5)
    np.testing.assert_allclose(std.numpy() / size, expected_std / size, atol=1e-5)
    assert std.numpy().max() > 0


def test_kernel_of_the_first_outputs() -> None:
    """The parameters are those of a fit to the first output alone; all outputs are predicted."""
    force, outputs = data(60)
    model = GaussianProcess(60, tuned_outputs=1)
    model.fit(force, outputs, torch.Generator().manual_seed(0))
    torch.testing.assert_close(model.kernel, fitted(60, force, outputs[:, :1]).kernel)
    assert (model.kernel - fitted(60, force, outputs).kernel).abs().max() > 1e-3
    assert model(force)[0].shape == (60, 3)


def test_kernel_by_hand() -> None:
    """Mean and variance at the first of two samples with distance r = 1, for given a, ℓ, σ²."""
    model = GaussianProcess(2)
    a, length, noise = 2.0, 0.5, 0.1
    k = a * np.exp(-1 / (2 * length**2))
    covariance = np.array([[a + noise, k], [k, a + noise]])
    y = np.array([[1.0], [-1.0]])
    model.kernel = torch.tensor([a, length, noise], dtype=torch.float64)
    model.inputs = torch.tensor([[0.0, 0.0], [1.0, 0.0]], dtype=torch.float64)
    model.cholesky = torch.from_numpy(np.linalg.cholesky(covariance))
    model.alpha = torch.from_numpy(np.linalg.solve(covariance, y))
    model.mean, model.std = torch.tensor([7.0]).double(), torch.tensor([3.0]).double()
    row = np.array([a, k])
    mean, std = model(torch.zeros(1, 2, 1, dtype=torch.float64))
    assert mean.item() == pytest.approx(7 + 3 * (row @ np.linalg.solve(covariance, y)).item())
    variance = a + noise - row @ np.linalg.solve(covariance, row)
    assert std.item() == pytest.approx(3 * np.sqrt(variance))


def test_error_falls_with_samples_and_spread_with_them() -> None:
    force, outputs = data(150)
    new, expected = data(100, seed=1)
    errors, spreads = [], []
    for samples in (20, 150):
        mean, std = fitted(samples, force, outputs)(new)
        errors.append(((mean - expected) / outputs.std(dim=0)).abs().mean().item())
        spreads.append((std / outputs.std(dim=0)).mean().item())
    assert errors[1] < 0.1 * errors[0]
    assert spreads[1] < 0.3 * spreads[0]


def test_unsure_far_from_the_data() -> None:
    """Far from all samples, mean and variance are the prior's: a + σ_n² times the outputs'."""
    force, outputs = data(80)
    model = fitted(80, force, outputs)
    mean, std = model(torch.full((1, 2, 3), 1e6, dtype=torch.float64))
    torch.testing.assert_close(mean[0], outputs.mean(dim=0))
    prior = (model.kernel[0] + model.kernel[2]).sqrt() * outputs.std(dim=0, correction=0)
    torch.testing.assert_close(std[0], prior)


def test_number_of_samples() -> None:
    force, outputs = data(80)
    model = fitted(25, force, outputs)
    assert model.inputs.shape == (25, 6)
    assert model.cholesky.shape == (25, 25)
    rows = force.flatten(1).tolist()
    assert all(row in rows for row in model.inputs.tolist())
