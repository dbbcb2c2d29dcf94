from __future__ import annotations

import numpy as np
import pytest
import torch

from surrogate.likelihoods import Loss, deterministic_loss, output_channels


@pytest.mark.parametrize("dimension", [2, 3])
def test_one_channel_a_component(dimension: int) -> None:
    assert output_channels("deterministic", dimension) == dimension


@pytest.mark.parametrize(("loss", "power"), [("mse", 2), ("mae", 1)])
def test_against_numpy(loss: Loss, power: int) -> None:
    predicted, reference = np.random.default_rng(0).normal(size=(2, 5, 2, 8, 4))
    expected = np.mean((np.abs(predicted - reference) / 0.25) ** power)
    found = deterministic_loss(
        loss, torch.from_numpy(predicted), torch.from_numpy(reference), torch.tensor(0.25)
    )
    assert found.item() == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize(
    ("loss", "expected"),
    [
        ("mse", 3.125),  # errors of 3 and -4 over a unit of 2: (1.5² + 2²) / 2
        ("mae", 1.75),  # (1.5 + 2) / 2
    ],
)
def test_by_hand(loss: Loss, expected: float) -> None:
    predicted = torch.tensor([[3.0, -4.0]])
    found = deterministic_loss(loss, predicted, torch.zeros(1, 2), torch.tensor(2.0))
    assert found.item() == expected
