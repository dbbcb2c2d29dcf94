"""What a program says to PyTorch elsewhere does not change a network that it loads."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager

import numpy as np
import pytest
import torch

import surrogate
from shared_schema.common.errors import InputError


@contextmanager
def default_dtype(dtype: torch.dtype) -> Iterator[None]:
    torch.set_default_dtype(dtype)
    try:
        yield
    finally:
        torch.set_default_dtype(torch.float32)


@pytest.fixture(scope="module")
def model() -> surrogate.Surrogate:
    return surrogate.load("breast3d")


def weight(model: surrogate.Surrogate) -> torch.Tensor:
    """1000 N/m³ downwards, shared by the nodes that move."""
    load = torch.zeros(model.geometry.coordinates.shape, dtype=torch.float64)
    load[torch.tensor(~model.geometry.clamped), 2] = -1e-3
    return load


@pytest.mark.parametrize(
    "around",
    [
        default_dtype(torch.float16),
        default_dtype(torch.float64),
        torch.device("meta"),
        torch.inference_mode(),
    ],
    ids=["float16", "float64", "meta", "inference"],
)
def test_loaded_within(around: AbstractContextManager[None], model: surrogate.Surrogate) -> None:
    """Its predictions are those of any other, to the last bit, and so are their derivatives."""
    with around:
        other = surrogate.load("breast3d")
    gradients = []
    for each in (model, other):
        load = weight(each).requires_grad_()
        found = each.predict(load)
        (gradient,) = torch.autograd.grad(found.square().sum(), load)
        gradients.append((found.detach(), gradient))
    assert torch.equal(gradients[0][0], gradients[1][0])
    assert torch.equal(gradients[0][1], gradients[1][1])


def test_tensors_of_other_layouts(model: surrogate.Surrogate) -> None:
    """A view that PyTorch negates when it is read is an array like any other."""
    load = weight(model)
    plain = model.predict(-load)
    np.testing.assert_array_equal(model.predict(torch._neg_view(load)), plain)
    for unlike in (load.to_sparse(), load.to_sparse_csr(), load.to("meta")):
        with pytest.raises(InputError, match="forces are a tensor without all its numbers"):
            model.predict(unlike)
