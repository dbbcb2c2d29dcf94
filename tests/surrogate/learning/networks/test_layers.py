"""Normalisation between the convolutions of a U-Net."""

from __future__ import annotations

from typing import Any

import pytest
import torch
from pydantic import ValidationError
from torch import nn

from surrogate.learning.networks.layers import LastAxisNorm
from surrogate.learning.networks.unet import UNet, UNetConfig, normalised_biases


@pytest.mark.parametrize("size", [(5, 4), (2, 3, 4)])
def test_rows_of_the_last_axis(size: tuple[int, ...]) -> None:
    """Means over all other axes, as `BatchNormalization(axis=-1)` of Keras takes them."""
    torch.manual_seed(0)
    fields = 3 + 2 * torch.randn(6, 8, *size, dtype=torch.float64)
    norm = LastAxisNorm(len(size), size[-1], momentum=0.01, epsilon=1e-3).double().train()
    others = tuple(range(fields.ndim - 1))
    mean, variance = fields.mean(others), fields.var(others, unbiased=False)
    torch.testing.assert_close(norm(fields), (fields - mean) / torch.sqrt(variance + 1e-3))
    torch.testing.assert_close(norm.norm.running_mean, 0.01 * mean)
    torch.testing.assert_close(norm.norm.running_var, 0.99 + 0.01 * fields.var(others))


@pytest.mark.parametrize(("dimension", "size"), [(2, (16, 4)), (3, (8, 4, 5))])
def test_unet_of_the_last_axis(dimension: int, size: tuple[int, ...]) -> None:
    """Every level has as many rows as its grid, and predicts by running means."""
    config = UNetConfig(channels=4, batch_norm="last_axis", initialisation="glorot")
    network = UNet(dimension, dimension, config, last_axis=size[-1])
    norms = [module for module in network.modules() if isinstance(module, LastAxisNorm)]
    padded = 8 if size[-1] == 4 else 12  # twice two zeros, a multiple of four
    assert [len(each.norm.weight) for each in norms] == [
        *(padded // 2**level for level in (0, 0, 1, 1, 2, 2, 1, 1, 0, 0))
    ]
    fields = torch.randn(3, dimension, *size)
    assert network(fields).shape == fields.shape
    network.eval()
    torch.testing.assert_close(network(fields)[:1], network(fields[:1]))
    assert not list(normalised_biases(network))


def test_groups() -> None:
    """One group is layer normalisation: a sample's scale is lost, whatever the batch."""
    network = UNet(2, 2, UNetConfig(levels=2, channels=8, batch_norm=False, group_norm=1))
    network.double()
    fields = 1e3 * torch.randn(2, 2, 8, 4, dtype=torch.float64)
    torch.testing.assert_close(network(2 * fields), network(fields), rtol=1e-5, atol=1e-8)


def test_true_is_channels() -> None:
    """The same network, with the constants of PyTorch."""
    found = [
        [type(module) for module in UNet(2, 2, UNetConfig(channels=4, batch_norm=norm)).modules()]
        for norm in (True, "channels")
    ]
    assert found[0] == found[1]
    of_keras = UNetConfig(channels=4, batch_norm_momentum=0.01, batch_norm_epsilon=1e-3)
    norms = [each for each in UNet(2, 2, of_keras).modules() if isinstance(each, nn.BatchNorm2d)]
    assert [(norm.momentum, norm.eps) for norm in norms] == [(0.01, 1e-3)] * 10


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"group_norm": 2}, "expected one of them"),
        ({"batch_norm": False, "group_norm": 3, "channels": 4}, "expected a divisor"),
        ({"batch_norm": "rows"}, "batch_norm"),
    ],
)
def test_wrong_keys(keys: dict[str, Any], message: str) -> None:
    with pytest.raises(ValidationError, match=message):
        UNetConfig(**keys)
