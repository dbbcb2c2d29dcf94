"""The paper's network for the 3D beam: 4 levels, 128 channels, a grid of 28 × 12 × 12 nodes."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

from surrogate.learning.networks.field_network import parameter_count
from surrogate.learning.networks.unet import UNet, UNetConfig
from surrogate.learning.optim.optimisers import OptimiserConfig, make_optimisers
from surrogate.learning.probabilistic.likelihoods import deterministic_loss


@pytest.mark.slow
def test_a_training_step() -> None:
    """A small step of Adam lowers the loss; the batch size is 1, the paper's is 4."""
    torch.manual_seed(0)
    network = UNet(3, 3, UNetConfig(levels=4))
    assert parameter_count(network) == pytest.approx(93.4e6, rel=1e-3)
    optimisers = make_optimisers(network, OptimiserConfig(learning_rate=1e-6))
    force = torch.zeros(1, 3, 28, 12, 12)
    force[0, :, 20, 6, 11] = torch.tensor([0.5, 0.0, -1.0])
    reference = torch.linspace(0, 1, 28).square().reshape(1, 1, 28, 1, 1) * force.sum((2, 3, 4))[
        :, :, None, None, None
    ].expand(1, 3, 28, 12, 12)

    def loss() -> Tensor:
        return deterministic_loss("mse", network(force), reference, torch.ones(()))

    before = loss()
    before.backward()  # type: ignore[no-untyped-call]
    for optimiser in optimisers:
        optimiser.step()
    with torch.no_grad():
        assert loss() < before
