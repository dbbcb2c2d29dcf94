"""Dense layers in NumPy against PyTorch's, in double precision."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from torch import nn

from surrogate.inference.dense_in_numpy import DenseInNumPy


@pytest.mark.parametrize("activation", [nn.ReLU, nn.SiLU, nn.GELU])
@pytest.mark.parametrize("shape", [(6,), (5, 6)])
def test_it_is_the_perceptron_of_pytorch(
    activation: type[nn.Module], shape: tuple[int, ...]
) -> None:
    """The largest error is that of float32: 2e-6 of the largest value."""
    torch.manual_seed(0)
    layers = nn.Sequential(
        *(nn.Linear(6, 64), activation(), nn.Linear(64, 64), activation()),
        *(nn.Linear(64, 9, bias=False), nn.Linear(9, 3)),
    )
    x = np.random.default_rng(0).normal(size=shape).astype(np.float32)
    found = DenseInNumPy(layers)(x)
    with torch.no_grad():
        expected = layers.double()(torch.from_numpy(x).double()).numpy()
    assert found.dtype == np.float32
    np.testing.assert_allclose(found, expected, rtol=0, atol=2e-6 * np.abs(expected).max())


def test_the_argument_is_not_changed(recwarn: pytest.WarningsRecorder) -> None:
    layers = nn.Sequential(nn.Linear(2, 3), nn.SiLU())
    x = np.full(2, -1e6, np.float32)
    assert np.isfinite(DenseInNumPy(layers)(x)).all()
    assert x.tolist() == [-1e6, -1e6]
    assert not len(recwarn)
