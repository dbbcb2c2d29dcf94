from __future__ import annotations

import math
from dataclasses import replace

import pytest
import torch
from torch import Tensor, nn

from shared_schema.manifest import ComponentStatistics, StructuredInfo
from surrogate.learning.data.samples import Samples
from surrogate.learning.networks.field_network import SMALLEST_STD, FieldNetwork
from tests.surrogate.l_shape import L_SHAPE


def info_with(force: ComponentStatistics, displacement: ComponentStatistics) -> StructuredInfo:
    return StructuredInfo(
        grid_shape=(3, 3),
        train=1,
        test=1,
        split_seed=0,
        force=force,
        displacement=displacement,
        source_digest="",
    )


INFO = info_with(
    ComponentStatistics(mean=(0.0, 0.0), std=(0.1, 0.2), max_abs=(1.5, 2.5)),
    ComponentStatistics(mean=(0.3, -0.2), std=(0.4, 0.7), max_abs=(1.0, 2.0)),
)


class Constant(nn.Module):
    """A network that returns 1 everywhere and stores its input."""

    given: Tensor

    def forward(self, x: Tensor) -> Tensor:
        self.given = x
        return torch.ones_like(x)


def test_scales_by_hand() -> None:
    """The force scale is 2.5 / √3, the standard deviation of U(-2.5, 2.5).

    The displacement scale is √((0.3² + 0.4² + 0.2² + 0.7²) / 2) = √(0.78 / 2) = √0.39.
    """
    inner = Constant()
    network = FieldNetwork(inner, L_SHAPE, INFO)
    output = network(torch.full((1, 2, 3, 3), 5.0)).mean
    torch.testing.assert_close(inner.given, torch.full((1, 2, 3, 3), 2 * math.sqrt(3)))
    assert network.displacement_rms.item() == pytest.approx(math.sqrt(0.39))
    torch.testing.assert_close(output[0, :, 1], torch.full((2, 3), math.sqrt(0.39)))


def test_scale_of_resting_data_is_one() -> None:
    zero = ComponentStatistics(mean=(0.0, 0.0), std=(0.0, 0.0), max_abs=(0.0, 0.0))
    network = FieldNetwork(Constant(), L_SHAPE, info_with(INFO.force, zero))
    assert network.displacement_rms.item() == 1.0


def test_scale_by_node_by_hand() -> None:
    """Samples 3 and 4 have the root mean square √12.5; all-zero samples give `displacement_rms`."""
    network = FieldNetwork(Constant(), L_SHAPE, INFO)
    displacement = torch.zeros(2, 2, 3, 3)
    displacement[:, 1, 2, 0] = torch.tensor([3.0, -4.0])
    network.scale_output(Samples(displacement, displacement), by_node=True)
    expected = torch.full((2, 3, 3), math.sqrt(0.39))
    expected[1, 2, 0] = math.sqrt(12.5)
    torch.testing.assert_close(network.displacement_scale, expected)
    assert network(torch.zeros(1, 2, 3, 3)).mean[0, 1, 2, 0].item() == pytest.approx(
        math.sqrt(12.5)
    )


def test_zero_at_clamped_nodes_and_where_there_is_none() -> None:
    output = FieldNetwork(Constant(), L_SHAPE, INFO)(torch.zeros(4, 2, 3, 3)).mean
    moving = [[False, False, False], [True, True, True], [True, True, False]]
    assert torch.equal(output != 0, torch.tensor(moving).expand(4, 2, 3, 3))


class MeansAndSpreads(nn.Module):
    """A network that returns a mean of 2 and a given ρ everywhere."""

    def __init__(self, rho: float) -> None:
        super().__init__()
        self.rho = rho

    def forward(self, x: Tensor) -> Tensor:
        return torch.cat((torch.full_like(x, 2.0), torch.full_like(x, self.rho)), dim=1)


@pytest.mark.parametrize("rho", [0.0, -3.0, 30.0, -200.0])
def test_spread_by_hand(rho: float) -> None:
    """σ is ln(1 + e^ρ) times the displacement scale √0.39 m, and at least 1e-6 times the scale."""
    mean, std = FieldNetwork(MeansAndSpreads(rho), L_SHAPE, INFO)(torch.zeros(4, 2, 3, 3))
    softplus = math.log1p(math.exp(rho)) + SMALLEST_STD
    assert mean.shape == std.shape == (4, 2, 3, 3)
    assert mean[3, 1, 1, 2].item() == pytest.approx(2 * math.sqrt(0.39))
    assert std[3, 1, 1, 2].item() == pytest.approx(softplus * math.sqrt(0.39), rel=1e-6)
    assert std[3, 1, 1, 2] > 0
    moving = torch.tensor([[False] * 3, [True] * 3, [True, True, False]]).expand(4, 2, 3, 3)
    assert torch.equal(std != 0, moving)
    assert torch.equal(mean != 0, moving)


def test_spread_is_scaled_by_node_as_the_mean_is() -> None:
    """The scales are 3 and 5 m at two nodes; σ is ln 2 times the scale."""
    network = FieldNetwork(MeansAndSpreads(0.0), L_SHAPE, INFO)
    displacement = torch.zeros(1, 2, 3, 3)
    displacement[0, 0, 1, 0], displacement[0, 1, 2, 1] = 3.0, 5.0
    network.scale_output(Samples(displacement, displacement), by_node=True)
    std = network(torch.zeros(1, 2, 3, 3)).std[0]
    assert std[0, 1, 0].item() == pytest.approx(3 * math.log(2), rel=1e-5)
    assert std[1, 2, 1].item() == pytest.approx(5 * math.log(2), rel=1e-5)


def test_free_components_by_hand() -> None:
    """Nodes 3 to 7 are free, at grid points of the same numbers; point 8 is no node.

    The second component has the numbers from 9 on. With node 5 held across, 14 is not free.
    """
    network = FieldNetwork(Constant(), L_SHAPE, INFO)
    assert network.free_components.tolist() == [3, 4, 5, 6, 7, 12, 13, 14, 15, 16]
    single = L_SHAPE.held.copy()
    single[5, 1] = True
    network = FieldNetwork(Constant(), replace(L_SHAPE, single=single), INFO)
    assert network.free_components.tolist() == [3, 4, 5, 6, 7, 12, 13, 15, 16]
