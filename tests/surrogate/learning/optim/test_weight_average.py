from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
import torch
from safetensors.torch import load_file
from torch import Tensor, nn

from shared_schema.common.errors import InputError
from surrogate.learning.data.dataset import Dataset
from surrogate.learning.models.kinds import run_config
from surrogate.learning.models.unet_model import UNetModel
from surrogate.learning.optim.final_weights import WeightAverage
from tests.surrogate.resuming import assert_resumes, trained, untimed

MakeConfig = Callable[..., UNetModel]


def test_average_by_hand() -> None:
    """Averages of 1, 2, 4 at d = 1/2: 1; (1/2 + 2) / (3/2) = 5/3; (1/4 + 1 + 4) / (7/4) = 3."""
    network = nn.Linear(1, 1, bias=False)
    nn.init.constant_(network.weight, 99.0)  # the average does not contain the initial weight
    average = WeightAverage(network, 0.5)
    found = []
    for value in (1.0, 2.0, 4.0):
        nn.init.constant_(network.weight, value)
        average.update(network)
        found.append(average.module.get_parameter("weight").item())
    assert found == pytest.approx([1.0, 5 / 3, 3.0], rel=1e-6)


def test_statistics_of_batch_norm_are_averaged_and_counted() -> None:
    """Running means 1, 3 at d = 1/2 average to (1/2 + 3) / (3/2) = 7/3; the count is the latest."""
    network = nn.BatchNorm2d(1)
    average = WeightAverage(network, 0.5)
    for mean, count in [(1.0, 10), (3.0, 20)]:
        network.get_buffer("running_mean").fill_(mean)
        network.get_buffer("num_batches_tracked").fill_(count)
        average.update(network)
    assert average.module.get_buffer("running_mean").item() == pytest.approx(7 / 3, rel=1e-6)
    assert average.module.get_buffer("num_batches_tracked").item() == 20


def flat(network: nn.Module) -> Tensor:
    """Return all weights and statistics as one vector, without integers."""
    tensors = (*network.parameters(), *network.buffers())
    return torch.cat([t.flatten() for t in tensors if t.is_floating_point()])


@pytest.mark.parametrize("batch_norm", [False, True])
def test_model_is_the_average_over_the_steps(
    tmp_path: Path,
    dataset: Dataset,
    make_config: MakeConfig,
    monkeypatch: pytest.MonkeyPatch,
    batch_norm: bool,
) -> None:
    """The average equals the sum over all steps, computed in float64."""
    decay, weights = 0.8, list[Tensor]()
    update = WeightAverage.update

    def record(self: WeightAverage[nn.Module], network: nn.Module) -> None:
        update(self, network)
        weights.append(flat(network).double())
        averages[:] = [flat(self.module)]

    averages: list[Tensor] = []
    monkeypatch.setattr(WeightAverage, "update", record)
    config = make_config(epochs=3, ema=decay, batch_norm=batch_norm)
    run = trained(config, dataset, tmp_path / "run")
    assert len(weights) == 9  # 43 training samples in batches of 16, for three epochs
    shares = decay ** torch.arange(8, -1, -1, dtype=torch.float64)
    expected = (shares[:, None] * torch.stack(weights)).sum(0) / shares.sum()
    torch.testing.assert_close(averages[0].double(), expected, rtol=1e-5, atol=1e-6)
    checkpoint, model = load_file(run.checkpoint), load_file(run.model)
    for name in checkpoint:
        if name.startswith("average."):
            assert torch.equal(model[name.removeprefix("average.")], checkpoint[name])
    assert not torch.equal(
        checkpoint["network.network.head.weight"], checkpoint["average.network.head.weight"]
    )


def test_average_is_what_is_validated(
    tmp_path: Path, dataset: Dataset, make_config: MakeConfig
) -> None:
    """Training is the same with the average; validation differs, except after the first step."""
    plain = trained(make_config(epochs=2, batch_size=64), dataset, tmp_path / "plain")
    averaged = trained(
        make_config(epochs=2, batch_size=64, ema=0.9), dataset, tmp_path / "averaged"
    )
    one, other = untimed(plain), untimed(averaged)
    assert [line["train_loss"] for line in one] == [line["train_loss"] for line in other]
    assert one[0]["validation_loss"] == other[0]["validation_loss"]
    assert one[1]["validation_loss"] != other[1]["validation_loss"]


@pytest.mark.parametrize("batch_norm", [False, True])
def test_average_is_resumed(
    tmp_path: Path, dataset: Dataset, make_config: MakeConfig, batch_norm: bool
) -> None:
    config = make_config(epochs=4, ema=0.9, batch_norm=batch_norm)
    assert_resumes(config, dataset, tmp_path, stop_after=2)


@pytest.mark.parametrize("decay", [0.0, 1.0, -0.1])
def test_wrong_decay_is_named(decay: float) -> None:
    content = {"name": "a", "case": "b", "training": {"ema": decay}}
    with pytest.raises(InputError, match=rf"key 'training.ema' = {decay}"):
        run_config(content, "a.yaml")
