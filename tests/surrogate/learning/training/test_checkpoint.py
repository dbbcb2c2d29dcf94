from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import torch
from torch import nn

from shared_schema.common.errors import InputError
from surrogate.learning.networks.unet import UNet, UNetConfig
from surrogate.learning.optim.optimisers import OptimiserConfig, make_optimisers
from surrogate.learning.training.checkpoint import load_checkpoint, save_checkpoint


def make(seed: int, memory_format: torch.memory_format) -> tuple[nn.Module, list[Any]]:
    torch.manual_seed(seed)
    dimension = 3 if memory_format == torch.channels_last_3d else 2
    network = UNet(dimension, dimension, UNetConfig(levels=2, channels=8))
    network = network.to(memory_format=memory_format)  # type: ignore[call-overload]
    return network, make_optimisers(network, OptimiserConfig(name="muon", learning_rate=1e-2))


def step(network: nn.Module, optimisers: list[Any], seed: int) -> None:
    dimension = 3 if any(p.dim() == 5 for p in network.parameters()) else 2
    shape = (4, dimension, 8, 4, 4)[: dimension + 2]
    x = torch.randn(shape, generator=torch.Generator().manual_seed(seed))
    network.zero_grad()
    network(x).square().sum().backward()
    for optimiser in optimisers:
        optimiser.step()


@pytest.mark.parametrize(
    "memory_format",
    [torch.contiguous_format, torch.channels_last, torch.channels_last_3d],
    ids=str,
)
def test_next_step_is_the_same(tmp_path: Path, memory_format: torch.memory_format) -> None:
    """Weights, running means and both optimisers' states are restored, in any memory layout."""
    path = tmp_path / "last.safetensors"
    network, optimisers = make(0, memory_format)
    step(network, optimisers, 1)
    save_checkpoint(path, 7, 12.5, {"network": network}, optimisers)
    other, other_optimisers = make(99, memory_format)
    assert load_checkpoint(path, {"network": other}, other_optimisers) == (7, 12.5)
    step(network, optimisers, 2)
    step(other, other_optimisers, 2)
    expected = network.state_dict()
    for name, value in other.state_dict().items():
        assert torch.equal(value, expected[name]), name


@pytest.mark.parametrize("content", [b"", b"{}", b"\x10\0\0\0\0\0\0\0not json at all!", b"x" * 500])
def test_damaged_file_is_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "last.safetensors"
    path.write_bytes(content)
    network, optimisers = make(0, torch.contiguous_format)
    with pytest.raises(InputError, match=r"last\.safetensors: damaged"):
        load_checkpoint(path, {"network": network}, optimisers)


def test_truncated_file_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "last.safetensors"
    network, optimisers = make(0, torch.contiguous_format)
    save_checkpoint(path, 1, 1.0, {"network": network}, optimisers)
    path.write_bytes(path.read_bytes()[:-1])
    with pytest.raises(InputError, match="damaged"):
        load_checkpoint(path, {"network": network}, optimisers)
