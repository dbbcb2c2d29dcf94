from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
import torch
from torch import Tensor, nn

from surrogate.learning.data.dataset import Dataset
from surrogate.learning.models.model import TrainedModel
from surrogate.learning.models.unet_model import UNetModel
from surrogate.learning.networks.field_network import FieldNetwork
from surrogate.learning.networks.unet import UNet, UNetConfig
from surrogate.learning.probabilistic.likelihoods import Likelihood, Prediction
from surrogate.runtime.device import autocast, convolutions, lay_out
from tests.surrogate.resuming import assert_resumes, trained

MakeConfig = Callable[..., UNetModel]


@pytest.mark.parametrize("likelihood", ["deterministic", "maximum_likelihood"])
def test_convolutions_in_bfloat16_all_else_in_float32(
    tmp_path: Path,
    dataset: Dataset,
    make_config: MakeConfig,
    monkeypatch: pytest.MonkeyPatch,
    likelihood: Likelihood,
) -> None:
    """Only convolutions in training use bfloat16; validation and all other results use float32."""
    convolved: set[tuple[bool, torch.dtype]] = set()
    judged: set[torch.dtype] = set()
    convolve, loss = nn.Conv2d.forward, TrainedModel.data_loss

    def record_convolution(self: nn.Conv2d, x: Tensor) -> Tensor:
        result = convolve(self, x)
        if not result.is_meta:  # of the estimate of the memory
            convolved.add((torch.is_grad_enabled(), result.dtype))
        return result

    def record_loss(
        self: TrainedModel, prediction: Prediction, reference: Tensor, network: FieldNetwork
    ) -> Tensor:
        assert not torch.is_autocast_enabled("cpu")
        result = loss(self, prediction, reference, network)
        judged.update(t.dtype for t in (*prediction, reference, result) if t is not None)
        assert all(p.dtype == torch.float32 for p in network.parameters())
        return result

    monkeypatch.setattr(nn.Conv2d, "forward", record_convolution)
    monkeypatch.setattr(TrainedModel, "data_loss", record_loss)
    config = make_config(epochs=1, precision="bfloat16", likelihood=likelihood)
    trained(config, dataset, tmp_path / "run")
    assert convolved == {(True, torch.bfloat16), (False, torch.float32)}
    assert judged == {torch.float32}


def test_training_is_that_of_float32_to_rounding(
    tmp_path: Path, dataset: Dataset, make_config: MakeConfig
) -> None:
    """bfloat16 has 8 significant bits (0.4 %); round-off of several layers is a few per cent."""
    losses = []
    for precision in ("float32", "bfloat16"):
        run = trained(make_config(epochs=4, precision=precision), dataset, tmp_path / precision)
        losses.append([line["train_loss"] for line in run.metric_lines()])
    assert losses[1] == pytest.approx(losses[0], rel=0.05)
    assert losses[1] != losses[0]


def test_bfloat16_resumes(tmp_path: Path, dataset: Dataset, make_config: MakeConfig) -> None:
    assert_resumes(make_config(epochs=2, precision="bfloat16"), dataset, tmp_path, stop_after=1)


def layout(dimension: int, precision: str, device: torch.device) -> torch.memory_format:
    """Return the memory layout of the kernels of a network."""
    convolution = {2: nn.Conv2d, 3: nn.Conv3d}[dimension](4, 4, 3)
    lay_out(convolution, dimension, precision, device)  # type: ignore[arg-type]
    last = {2: torch.channels_last, 3: torch.channels_last_3d}[dimension]
    is_last = convolution.weight.is_contiguous(memory_format=last)
    return last if is_last else torch.contiguous_format


def test_memory_layouts() -> None:
    cpu = torch.device("cpu")
    assert layout(2, "float32", cpu) == torch.channels_last
    assert layout(3, "float32", cpu) == torch.channels_last_3d
    assert layout(3, "tensorfloat32", cpu) == torch.channels_last_3d
    assert layout(3, "bfloat16", cpu) == torch.contiguous_format


def test_only_kernels_are_laid_out() -> None:
    """A scale for every node, (3, nx, ny, nz), has four dimensions but is no convolution kernel."""
    convolution, scale = nn.Conv3d(4, 4, 3), nn.Parameter(torch.ones(3, 4, 5, 6))
    convolution.register_parameter("scale", scale)
    lay_out(convolution, 3, "float32", torch.device("cpu"))
    assert convolution.weight.is_contiguous(memory_format=torch.channels_last_3d)
    assert scale.is_contiguous()


def test_bfloat16_in_3d_beside_a_parameter_of_four_dimensions() -> None:
    """The gradients agree with float32 to 3 %: bfloat16 has 8 significant bits, 0.4 %."""
    cpu, gradients = torch.device("cpu"), []
    for precision in ("float32", "bfloat16"):
        torch.manual_seed(0)
        network = UNet(3, 3, UNetConfig(levels=2, channels=8))
        scale = nn.Parameter(torch.rand(3, 8, 4, 4))
        network.register_parameter("scale", scale)
        lay_out(network, 3, precision, cpu)
        with autocast(precision, cpu):
            output = network(torch.randn(2, 3, 8, 4, 4))
        (output.float() * scale).square().mean().backward()
        assert scale.grad is not None
        gradients.append(scale.grad)
    assert (gradients[1] - gradients[0]).norm() < 0.03 * gradients[0].norm()


def test_only_tensorfloat32_rounds_factors_on_a_gpu(
    tmp_path: Path, dataset: Dataset, make_config: MakeConfig, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Forward and backward passes of training see the flag of cuDNN, validation never does."""
    seen: set[tuple[bool, bool]] = set()
    convolve, before = nn.Conv2d.forward, torch.backends.cudnn.allow_tf32

    def record(self: nn.Conv2d, x: Tensor) -> Tensor:
        result = convolve(self, x)
        if result.is_meta:  # of the estimate of the memory
            return result
        seen.add((torch.is_grad_enabled(), torch.backends.cudnn.allow_tf32))
        if result.requires_grad:
            flag = torch.backends.cudnn
            result.register_hook(lambda _: seen.add((True, flag.allow_tf32)))  # type: ignore[no-untyped-call]
        return result

    monkeypatch.setattr(nn.Conv2d, "forward", record)
    for precision, rounds in {"float32": False, "bfloat16": False, "tensorfloat32": True}.items():
        seen.clear()
        trained(make_config(epochs=1, precision=precision), dataset, tmp_path / precision)
        assert seen == {(True, rounds), (False, False)}
        assert torch.backends.cudnn.allow_tf32 == before


@pytest.mark.gpu
@pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device")
def test_rounding_of_factors_on_cuda() -> None:
    """float32 agrees with float64 to 1e-6, TF32 (11 significant bits) to 1e-3 but not to 1e-5."""
    torch.manual_seed(0)
    x, kernel = torch.randn(4, 64, 32, 32).cuda(), torch.randn(64, 64, 3, 3).cuda()
    exact = nn.functional.conv2d(x.double(), kernel.double())
    errors = {}
    for precision in ("float32", "tensorfloat32"):
        with convolutions(precision):
            found = nn.functional.conv2d(x, kernel)
        errors[precision] = float((found - exact).norm() / exact.norm())
    assert errors["float32"] < 1e-6
    assert 1e-5 < errors["tensorfloat32"] < 1e-3


@pytest.mark.gpu
@pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device")
def test_memory_layouts_on_cuda() -> None:
    cuda = torch.device("cuda")
    assert layout(2, "bfloat16", cuda) == torch.channels_last
    assert layout(3, "float32", cuda) == torch.contiguous_format
    assert layout(3, "tensorfloat32", cuda) == torch.channels_last_3d
    assert layout(3, "bfloat16", cuda) == torch.channels_last_3d
