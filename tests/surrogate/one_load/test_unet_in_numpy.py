"""U-Nets in NumPy against the same network in PyTorch, in double precision."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch
from torch import nn

from surrogate.networks.unet import UNet, UNetConfig
from surrogate.one_load.unet_in_numpy import UNetInNumPy, children, neighbours, parents

PLAIN = {"padding": 0, "batch_norm": False}
MECHANICS = ("force", "linear_gradient")
CASES: list[tuple[tuple[int, ...], dict[str, Any]]] = [
    ((16, 4), {"channels": 32, "activation": "silu", "inputs": MECHANICS, **PLAIN}),
    ((13, 5), {"channels": 4, "levels": 2, "padding": 1, "activation": "gelu"}),
    ((13, 5), {"channels": 4, "force_transforms": ("asinh",), "inputs": MECHANICS}),
    ((5, 3), {"channels": 4, "levels": 1, "force_transforms": ("saturating",)}),
    ((6, 7), {"channels": 4, "levels": 4, "padding": 3, "multiplier": 1}),
    ((7, 5, 3), {"channels": 3, "activation": "silu"}),
    ((8, 4, 4), {"channels": 4, "activation": "silu", "inputs": MECHANICS, **PLAIN}),
]


def make_unet(dimension: int, outputs: int, config: UNetConfig) -> UNet:
    """A U-Net with random weights, biases and statistics of the batch norms."""
    torch.manual_seed(0)
    unet = UNet(dimension, outputs, config).eval()
    for module in unet.modules():
        if isinstance(module, nn.Conv2d | nn.Conv3d):
            assert module.bias is not None
            nn.init.normal_(module.bias)
        if isinstance(module, nn.BatchNorm2d | nn.BatchNorm3d):
            assert module.running_mean is not None
            assert module.running_var is not None
            nn.init.uniform_(module.weight, 0.5, 2)
            nn.init.normal_(module.bias)
            nn.init.normal_(module.running_mean)
            nn.init.uniform_(module.running_var, 0.5, 2)
    return unet


@pytest.mark.parametrize(("shape", "content"), CASES, ids=str)
def test_it_is_the_network_of_pytorch(shape: tuple[int, ...], content: dict[str, Any]) -> None:
    """Its largest error against double precision is that of float32: 2e-6 of the largest value."""
    d = len(shape)
    unet = make_unet(d, 2 * d, config := UNetConfig(**content))
    fields = np.random.default_rng(0).normal(size=(config.input_channels(d), *shape))
    found = UNetInNumPy(unet, shape, d)(
        np.ascontiguousarray(fields.reshape(len(fields), -1).T, np.float32)
    )
    with torch.no_grad():
        y = unet.double()(torch.from_numpy(fields.astype(np.float32)[None]).double())
    expected = y[0, :d].flatten(1).T.numpy()
    assert found.shape == (np.prod(shape), d)
    np.testing.assert_allclose(found, expected, atol=2e-6 * np.abs(expected).max(), rtol=0)


@pytest.mark.parametrize(("shape", "content"), CASES[:2] + CASES[-1:], ids=str)
def test_pytorch_convolves_grids_that_are_large_together(
    shape: tuple[int, ...], content: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Three loads alone, together, and as two and one."""
    d, points = len(shape), int(np.prod(shape))
    unet = make_unet(d, 2 * d, config := UNetConfig(**content))
    network = UNetInNumPy(unet, shape, d)
    size = 3, points, config.input_channels(d)
    fields = np.random.default_rng(0).normal(size=size).astype(np.float32)
    alone = np.stack([network(one) for one in fields])
    for most in (3 * points, 2 * points):
        monkeypatch.setattr("surrogate.one_load.unet_in_numpy.BY_PYTORCH", 2 * points)
        monkeypatch.setattr("surrogate.one_load.unet_in_numpy.AT_ONCE", most)
        found = network(fields)
        assert found.shape == alone.shape
        np.testing.assert_allclose(found, alone, atol=4e-6 * np.abs(alone).max(), rtol=0)


def test_many_points_are_gathered_in_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    unet = make_unet(2, 2, UNetConfig(channels=4))
    fields = np.random.default_rng(0).normal(size=(128, 2)).astype(np.float32)
    whole = UNetInNumPy(unet, (16, 8), 2)(fields)
    monkeypatch.setattr("surrogate.one_load.unet_in_numpy.GATHERED", 500)
    np.testing.assert_allclose(UNetInNumPy(unet, (16, 8), 2)(fields), whole, atol=1e-5)


def test_loads_are_convolved_together_as_far_as_the_cache_holds_them(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """By twos here: what is gathered for two loads fits, for three it does not."""
    unet = make_unet(2, 2, UNetConfig(channels=4, force_transforms=("asinh",)))
    fields = np.random.default_rng(0).normal(size=(5, 128, 2)).astype(np.float32)
    network = UNetInNumPy(unet, (16, 8), 2)
    assert network.at_once >= 5
    most = max(c.gathered for pair in (*network.encoder, *network.decoder) for c in pair)
    monkeypatch.setattr("surrogate.one_load.unet_in_numpy.GATHERED", 5 * most // 2)
    parts = UNetInNumPy(unet, (16, 8), 2)
    assert parts.at_once == 2
    one_by_one = np.stack([network(f) for f in fields])
    np.testing.assert_allclose(network(fields), one_by_one, atol=1e-5)
    np.testing.assert_allclose(parts(fields), one_by_one, atol=1e-5)


def test_points_of_the_levels() -> None:
    """A grid of 4 × 2 points has two coarse points of four points each; 8 is the row of zeros."""
    assert neighbours((4, 2))[3].tolist() == [0, 1, 8, 2, 3, 8, 4, 5, 8]
    assert children((4, 2)).T.tolist() == [[0, 1, 2, 3], [4, 5, 6, 7]]
    assert parents(children((4, 2))).tolist() == [0, 0, 0, 0, 1, 1, 1, 1, 2]


def test_no_warning_where_an_exponential_overflows(recwarn: pytest.WarningsRecorder) -> None:
    unet = make_unet(2, 2, UNetConfig(channels=4, activation="silu"))
    found = UNetInNumPy(unet, (16, 4), 2)(np.full((64, 2), 1e4, np.float32))
    assert np.isfinite(found).all()
    assert not len(recwarn)
