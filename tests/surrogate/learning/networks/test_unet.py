from __future__ import annotations

import math

import pytest
import torch
from torch import Tensor, nn
from torch.nn import functional

from surrogate.learning.networks.field_network import parameter_count
from surrogate.learning.networks.unet import (
    TRANSFORMS,
    Transform,
    UNet,
    UNetConfig,
    normalised_biases,
)


def count_by_formula(dimension: int, channels: list[int], batch_norm: bool) -> int:
    """Count the parameters of the network of Deshpande et al. (2022), Section 2.2, by layers.

    A convolution from a to b channels with kernels of 3^d has 3^d·a·b weights and b biases; a
    batch normalisation of b channels has b scales and b shifts; a level has two of both; the last
    convolution from c to d channels has kernels of 1.
    """
    taps: int = 3**dimension
    norm = 2 if batch_norm else 0

    def double(a: int, b: int) -> int:
        return taps * a * b + b + norm * b + taps * b * b + b + norm * b

    down = sum(double(a, b) for a, b in zip([dimension, *channels[:-1]], channels, strict=True))
    up = sum(double(a + b, b) for a, b in zip(channels[1:], channels[:-1], strict=True))
    return down + up + channels[0] * dimension + dimension


def test_parameters_of_the_paper_in_2d() -> None:
    """The network has 3 levels of 128, 256, 512 channels; a line is two convolutions and norms.

    down: 2→128→128 ........... 2304 + 147456 + 6·128 = 150528
          128→256→256 ......... 294912 + 589824 + 6·256 = 886272
          256→512→512 ......... 1179648 + 2359296 + 6·512 = 3542016
    up:   (512+256)→256→256 ... 1769472 + 589824 + 6·256 = 2360832
          (256+128)→128→128 ... 442368 + 147456 + 6·128 = 590592
    last: 128→2 ............... 256 + 2 = 258
    """
    by_hand = 150528 + 886272 + 3542016 + 2360832 + 590592 + 258
    found = parameter_count(UNet(2, 2, UNetConfig(levels=3, channels=128)))
    assert found == by_hand == count_by_formula(2, [128, 256, 512], True)
    assert round(found / 1e6, 2) == 7.53


def test_parameters_of_the_paper_in_3d() -> None:
    with torch.device("meta"):
        network = UNet(3, 3, UNetConfig(levels=4, channels=128))
    found = parameter_count(network)
    assert found == count_by_formula(3, [128, 256, 512, 1024], True)
    assert round(found / 1e6, 1) == 93.4


@pytest.mark.parametrize(
    "size", [(16, 4), (15, 7), (5, 3), (1, 1), (8, 8), (9, 4, 3), (6, 5, 7)], ids=str
)
@pytest.mark.parametrize("padding", [0, 1, 2])
def test_shape_of_any_grid_is_kept(size: tuple[int, ...], padding: int) -> None:
    dimension = len(size)
    config = UNetConfig(levels=3, channels=2, padding=padding, batch_norm=False)
    output = UNet(dimension, dimension, config)(torch.zeros(2, dimension, *size))
    assert output.shape == (2, dimension, *size)
    assert UNet(dimension, 5, config)(torch.zeros(1, dimension, *size)).shape[1] == 5


def make_identity(network: UNet, dimension: int) -> None:
    """Make every convolution the identity; the decoder passes the skip connection through."""
    centre = (1,) * dimension
    for module in network.modules():
        if isinstance(module, (nn.Conv2d, nn.Conv3d)):
            nn.init.zeros_(module.weight)
            assert module.bias is not None
            nn.init.zeros_(module.bias)
            inputs, outputs = module.in_channels, module.out_channels
            middle = centre if module.kernel_size[0] == 3 else (0,) * dimension
            with torch.no_grad():
                for channel in range(min(inputs, outputs)):
                    # the channels of the skip connection come after those of the coarser level
                    module.weight[(channel, inputs - outputs + channel, *middle)] = 1.0


@pytest.mark.parametrize("size", [(16, 4), (7, 5), (6, 5, 7)], ids=str)
@pytest.mark.parametrize("levels", [1, 2, 3])
def test_padding_and_cropping_keep_the_place(size: tuple[int, ...], levels: int) -> None:
    """A network of identities returns its input at the same grid points."""
    dimension = len(size)
    config = UNetConfig(
        levels=levels, channels=dimension, multiplier=1, padding=2, batch_norm=False
    )
    network = UNet(dimension, dimension, config)
    make_identity(network, dimension)
    field = torch.rand(2, dimension, *size, generator=torch.Generator().manual_seed(0))
    assert torch.equal(network(field), field)


def by_hand(x: Tensor, w: dict[str, Tensor], levels: int, padding: int) -> Tensor:
    """Compute the network by explicit functions, in evaluation mode with ReLU."""
    dimension = x.ndim - 2
    convolve = functional.conv2d if dimension == 2 else functional.conv3d
    pool = functional.max_pool2d if dimension == 2 else functional.max_pool3d
    size, unit = x.shape[2:], 2 ** (levels - 1)
    total = [math.ceil((n + 2 * padding) / unit) * unit for n in size]
    inside = (slice(None), slice(None), *(slice(padding, padding + n) for n in size))
    padded = torch.zeros(*x.shape[:2], *total)
    padded[inside] = x

    def double(x: Tensor, name: str) -> Tensor:
        for conv, norm in ((0, 1), (3, 4)):
            x = convolve(x, w[f"{name}.{conv}.weight"], w[f"{name}.{conv}.bias"], padding=1)
            mean, variance, scale, shift = (
                w[f"{name}.{norm}.{part}"].view(-1, *[1] * dimension)
                for part in ("running_mean", "running_var", "weight", "bias")
            )
            x = (x - mean) / torch.sqrt(variance + 1e-5) * scale + shift
            x = x.clamp(min=0)
        return x

    y, skipped = padded, []
    for level in range(levels):
        y = double(pool(y, 2) if level else y, f"encoder.{level}")
        skipped.append(y)
    for index, level in enumerate(range(levels - 2, -1, -1)):
        for axis in range(2, 2 + dimension):
            y = y.repeat_interleave(2, dim=axis)
        y = double(torch.cat((y, skipped[level]), dim=1), f"decoder.{index}")
    return convolve(y, w["head.weight"], w["head.bias"])[inside]


@pytest.mark.parametrize("size", [(7, 5), (6, 5, 3)], ids=str)
def test_forward_equals_the_network_written_out(size: tuple[int, ...]) -> None:
    dimension = len(size)
    generator = torch.Generator().manual_seed(1)
    network = UNet(dimension, dimension, UNetConfig(levels=3, channels=4, padding=2)).eval()
    for name, value in network.state_dict().items():
        if value.is_floating_point():
            low = 0.5 if name.endswith("running_var") else -0.5
            value.copy_(torch.rand(value.shape, generator=generator) + low)
    field = torch.randn(2, dimension, *size, generator=generator)
    expected = by_hand(field, network.state_dict(), 3, 2)
    assert expected.abs().max() > 0.1
    torch.testing.assert_close(network(field), expected, rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("linear", [0.01, 3.0, -12.0]),
        ("asinh", [0.01, math.log(3 + math.sqrt(10)), -math.log(12 + math.sqrt(145))]),
        ("saturating", [0.01, 1.5, -12 / 7]),  # 3 / √(1 + 9/3), 12 / √(1 + 144/3)
    ],
)
def test_inputs_by_hand(name: Transform, expected: list[float]) -> None:
    """All input functions are about f for small forces f."""
    found = TRANSFORMS[name](torch.tensor([0.01, 3.0, -12.0]))
    torch.testing.assert_close(found, torch.tensor(expected), rtol=1e-4, atol=0.0)


def test_members_take_the_inputs_in_turn() -> None:
    config = UNetConfig(levels=1, channels=4, force_transforms=("linear", "saturating"))
    force = torch.full((1, 2, 4, 4), 50.0)
    networks = [UNet(2, 2, config, member=member).eval() for member in range(3)]
    networks[1].load_state_dict(networks[0].state_dict())
    networks[2].load_state_dict(networks[0].state_dict())
    first, second, third = (network(force) for network in networks)
    torch.testing.assert_close(third, first)
    torch.testing.assert_close(second, networks[0](TRANSFORMS["saturating"](force)))
    assert (second - first).abs().max() > 0


def test_normalisation_takes_biases_away() -> None:
    """Their gradients are zero but for rounding, whatever they are."""
    torch.manual_seed(0)
    network = UNet(2, 2, UNetConfig(levels=2, channels=4)).double().train()
    x, biases = torch.randn(3, 2, 8, 4, dtype=torch.float64), list(normalised_biases(network))
    before = network(x)
    of_head, *of_biases = torch.autograd.grad(before.square().sum(), [network.head.weight, *biases])
    assert len(biases) == 6
    assert all(each.abs().max() < 1e-10 * of_head.abs().max() for each in of_biases)
    with torch.no_grad():
        for bias in biases:
            bias.add_(torch.randn_like(bias))
    torch.testing.assert_close(network(x), before)
    assert not list(normalised_biases(UNet(2, 2, UNetConfig(channels=4, batch_norm=False))))
