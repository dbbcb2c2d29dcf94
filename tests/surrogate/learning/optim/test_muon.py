from __future__ import annotations

from itertools import pairwise

import pytest
import torch
from torch import Tensor

from surrogate.learning.optim.optimisers import Muon, orthogonalise

SHAPES = [(8, 8), (4, 36), (36, 4), (64, 576), (576, 64), (1, 5), (16, 17)]


def random(shape: tuple[int, ...], seed: int = 0, scale: float = 1.0) -> Tensor:
    return scale * torch.randn(shape, generator=torch.Generator().manual_seed(seed))


def newton_schulz(matrix: Tensor) -> Tensor:
    """Iterate as in Jordan et al. (2024): X ← aX + (bA + cA²)X with A = XXᵀ."""
    x: Tensor = matrix.double()
    transposed = x.shape[0] > x.shape[1]
    if transposed:
        x = x.T
    x = x / x.norm()
    for _ in range(5):
        a = x @ x.T
        x = 3.4445 * x + (-4.7750 * a + 2.0315 * a @ a) @ x
    return x.T if transposed else x


@pytest.mark.parametrize("shape", [s for s in SHAPES if s[0] != s[1]], ids=str)
@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
def test_singular_values_come_near_one(shape: tuple[int, int], scale: float) -> None:
    """The iteration brings singular values to about 0.7 … 1.2 (Jordan et al. 2024)."""
    values = torch.linalg.svdvals(orthogonalise(random(shape, scale=scale)))
    assert values.min() > 0.6
    assert values.max() < 1.3


@pytest.mark.parametrize("shape", SHAPES, ids=str)
def test_direction_is_that_of_the_polar_factor(shape: tuple[int, int]) -> None:
    matrix = random(shape, seed=1)
    u, _, v = torch.linalg.svd(matrix, full_matrices=False)
    found, polar = orthogonalise(matrix), u @ v
    cosine = (found * polar).sum() / (found.norm() * polar.norm())
    assert cosine > 0.95


@pytest.mark.parametrize("shape", SHAPES, ids=str)
def test_gram_form_equals_the_textbook_iteration(shape: tuple[int, int]) -> None:
    matrix = random(shape, seed=2)
    expected = newton_schulz(matrix).float()
    torch.testing.assert_close(orthogonalise(matrix), expected, rtol=1e-3, atol=1e-3)
    torch.testing.assert_close(
        orthogonalise(matrix.double()), newton_schulz(matrix), rtol=1e-9, atol=1e-9
    )


def test_zero_gradient_changes_nothing() -> None:
    weight = torch.nn.Parameter(random((4, 4, 3, 3)))
    before = weight.detach().clone()
    weight.grad = torch.zeros_like(weight)
    Muon([weight], lr=0.1).step()
    assert torch.equal(weight, before)


def test_first_step_by_formula() -> None:
    """The weights become W(1 - η·λ) - η · 0.2 · √max(m, n) · NS(M).

    The momentum starts at zero, so it is 0.05 G, and Nesterov's M is 0.05 G + 0.95 · 0.05 G =
    0.0975 G. The normalisation removes this factor. m = 6 outputs, n = 5 · 3 · 3 = 45.
    """
    weight, gradient = random((6, 5, 3, 3), seed=3), random((6, 5, 3, 3), seed=4)
    parameter = torch.nn.Parameter(weight.clone())
    parameter.grad = gradient
    Muon([parameter], lr=0.1, weight_decay=0.5).step()
    direction = newton_schulz(gradient.reshape(6, 45)).float().view_as(weight)
    expected = weight * (1 - 0.1 * 0.5) - 0.1 * 0.2 * 45**0.5 * direction
    torch.testing.assert_close(parameter.detach(), expected, rtol=1e-4, atol=1e-4)


def test_steps_decrease_a_quadratic() -> None:
    target = random((8, 12), seed=5)
    weight = torch.nn.Parameter(torch.zeros(8, 12))
    optimiser = Muon([weight], lr=0.05)
    losses = []
    for _ in range(20):
        loss = (weight - target).square().sum()
        optimiser.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        optimiser.step()
        losses.append(loss.item())
    assert all(after < before for before, after in pairwise(losses))
