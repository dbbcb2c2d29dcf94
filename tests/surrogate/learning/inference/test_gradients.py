"""Predictions of tensors, and their gradients by the forces."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

import surrogate
from surrogate.learning.probabilistic.stochastic_passes import PASSES

pytestmark = pytest.mark.filterwarnings("ignore::surrogate.OutsideTrainingWarning")
SERIES = ("beam2d_any", "beam3d_any", "lshape2d_any")
RELATIVE = dict.fromkeys(SERIES, 1e-5) | {"beam3d_any_reduced": 0.1, "finger3d": 0.1}
# a reduced network adds its own error


def random_force(model: surrogate.Surrogate, seed: int) -> np.ndarray:
    """Forces on two free nodes, in N."""
    rng = np.random.default_rng(seed)
    force = np.zeros(model.geometry.coordinates.shape)
    nodes = rng.choice(np.flatnonzero(~model.geometry.clamped), 2, replace=False)
    force[nodes] = rng.uniform(-0.5, 0.5, (2, model.geometry.dimension))
    return force


@pytest.mark.parametrize("name", ["beam2d_any", "beam3d_any_reduced", "beam3d_any"])
def test_gradient_is_that_of_central_differences(name: str) -> None:
    """The load series of beam2d_any, a reduced network, and a series on a large body.

    Differences of steps of 3 % have errors of third order below 1e-4, and those of rounding.
    """
    model = surrogate.load(name)
    force = random_force(model, 0)
    direction = force * np.random.default_rng(1).uniform(0.5, 1.5, force.shape)
    weight = np.random.default_rng(2).normal(size=force.shape)
    given = torch.tensor(force, requires_grad=True)
    displacement = model.predict(given)
    scale = np.abs(model.predict(force)).max()
    assert np.abs(displacement.detach().numpy() - model.predict(force)).max() < 1e-5 * scale
    (gradient,) = torch.autograd.grad((displacement * torch.from_numpy(weight)).sum(), given)
    step = 0.03
    ends = [model.averaged_passes(force + s * direction).mean for s in (step, -step)]
    expected = ((ends[0] - ends[1]) * weight).sum() / (2 * step)
    found = float((gradient.numpy() * direction).sum())
    assert found == pytest.approx(expected, rel=2e-4)
    assert all(weights.requires_grad for weights in model.network.parameters())  # as before


@pytest.mark.parametrize("name", RELATIVE)
def test_gradient_without_a_load_is_the_linear_response(name: str) -> None:
    """At zero the displacement of the tip in y is linear in a force there, by K(0)⁻¹.

    So it is under loads whose squares are no numbers of single precision.
    """
    model = surrogate.load(name)
    tip, shape = model.geometry.tip, model.geometry.coordinates.shape
    unit = np.zeros(shape)
    unit[tip, 1] = 1.0
    expected = model.body.equilibrium.linear_response(unit[None])[0, tip, 1]
    for load in (0.0, 1e-20):
        given = torch.zeros((2, *shape), dtype=torch.float64)
        given[1, tip, 1] = load
        given.requires_grad_()
        displacement = model.predict(given)
        (gradient,) = torch.autograd.grad(displacement[:, tip, 1].sum(), given)
        assert torch.isfinite(gradient).all()
        np.testing.assert_allclose(gradient[:, tip, 1], expected, rtol=RELATIVE[name])
        if name in SERIES and load:
            alone = model.predict(given.detach().numpy()[1])[tip, 1]
            assert alone == pytest.approx(load * expected, rel=1e-5)
            assert displacement[1, tip, 1].item() == pytest.approx(load * expected, rel=1e-5)


def test_second_derivatives() -> None:
    """They are central differences of the first ones, with errors of third order and rounding."""
    model = surrogate.load("beam2d_any")
    direction = random_force(model, 0)
    weight = torch.from_numpy(np.random.default_rng(1).normal(size=direction.shape))

    def gradient(size: float, kept: bool = False) -> tuple[torch.Tensor, torch.Tensor]:
        force = torch.from_numpy(size * direction).requires_grad_()
        work = (model.predict(force) * weight).sum()
        return force, torch.autograd.grad(work, force, create_graph=kept)[0]

    for size in (0.0, 0.3):
        force, first = gradient(size, kept=True)
        (second,) = torch.autograd.grad((first * torch.from_numpy(direction)).sum(), force)
        expected = (gradient(size + 0.02)[1] - gradient(size - 0.02)[1]) / 0.04
        assert torch.linalg.norm(second - expected) < 1e-3 * torch.linalg.norm(expected)


def test_tensors_give_tensors() -> None:
    """Without gradients the numbers are those of NumPy; batches and single precision as well."""
    model = surrogate.load("beam2d_any")
    force = np.stack([random_force(model, seed) for seed in range(3)])
    for values in (force, force[0]):
        found = model.predict(torch.from_numpy(values))
        np.testing.assert_array_equal(found.numpy(), model.predict(values))
    assert model.predict(torch.from_numpy(force).float()).dtype == torch.float32
    with torch.no_grad():
        assert not model.predict(torch.from_numpy(force).requires_grad_()).requires_grad
    batch = torch.from_numpy(force).requires_grad_()
    assert model.predict(batch).requires_grad
    assert model.predict(batch).shape == batch.shape


def test_gradient_of_the_mean_of_all_passes(trained_bayes: Path) -> None:
    """The mean of 300 passes in double precision, also after a prediction without gradients."""
    model = surrogate.load(trained_bayes)
    force = random_force(model, 3)
    expected = model.predict_distribution(force, PASSES, 0).mean
    given = torch.from_numpy(force).requires_grad_()
    found = model.predict(given)
    np.testing.assert_allclose(found.detach().numpy(), expected, rtol=1e-4, atol=1e-7)
    (gradient,) = torch.autograd.grad(found.sum(), given)
    assert bool(gradient.any())
    np.testing.assert_array_equal(model.predict_distribution(force, PASSES, 0).mean, expected)
