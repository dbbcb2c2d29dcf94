"""Dense layers in NumPy against PyTorch's, in double precision."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from torch import nn

from surrogate.networks.reduced_network import DenseNetwork, ReducedConfig
from surrogate.one_load.reduced_in_numpy import DenseInNumPy


@pytest.mark.parametrize("activation", ["relu", "silu", "gelu"])
def test_it_is_the_network_of_pytorch(activation: str) -> None:
    """The largest error is that of float32: 2e-6 of the largest value."""
    torch.manual_seed(0)
    config = ReducedConfig.model_validate({"input_modes": 6, "width": 64, "activation": activation})
    network = DenseNetwork(config, 9)
    for parameter in network.parameters():
        nn.init.normal_(parameter, std=0.2)
    x = np.random.default_rng(0).normal(size=6).astype(np.float32)
    found = DenseInNumPy(network, 7)(x)
    with torch.no_grad():
        expected = network.double()(torch.from_numpy(x[None]).double())[0, :7].numpy()
    assert found.dtype == np.float32
    np.testing.assert_allclose(found, expected, rtol=0, atol=2e-6 * np.abs(expected).max())


def test_no_warning_where_an_exponential_overflows(recwarn: pytest.WarningsRecorder) -> None:
    network = DenseNetwork(ReducedConfig(input_modes=2, width=3), 4)
    x = np.full(2, -1e6, np.float32)
    assert np.isfinite(DenseInNumPy(network, 4)(x)).all()
    assert x.tolist() == [-1e6, -1e6]
    assert not len(recwarn)
