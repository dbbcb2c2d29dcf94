from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch
from torch import Tensor

from shared_schema.common.command_line import logged
from shared_schema.common.progress import Progress
from surrogate.learning.data.dataset import Dataset
from surrogate.learning.data.samples import Samples
from surrogate.learning.models.model import Model
from surrogate.learning.models.unet_model import UNetModel
from surrogate.learning.networks.unet import UNet, UNetConfig
from surrogate.learning.optim.optimisers import OptimiserConfig, make_optimisers, set_learning_rate
from surrogate.learning.runs.folder import RunFolder
from surrogate.learning.training import cuda_graph
from surrogate.learning.training.cuda_graph import can_capture
from surrogate.learning.training.data_parallel import ALONE
from surrogate.learning.training.loop import train
from surrogate.learning.training.trainer import Trainer
from tests.surrogate.resuming import trained, untimed

MakeConfig = Callable[..., UNetModel]


def test_where_steps_can_be_captured() -> None:
    cpu, cuda = torch.device("cpu"), torch.device("cuda")
    assert [can_capture(cpu, 1), can_capture(cuda, 1), can_capture(cuda, 2)] == [False, True, False]


def test_on_cpu_training_goes_on_without(
    tmp_path: Path, dataset: Dataset, make_config: MakeConfig, capsys: pytest.CaptureFixture[str]
) -> None:
    plain = trained(make_config(epochs=2), dataset, tmp_path / "plain")
    assert "warning" not in capsys.readouterr().err
    with logged("surrogate"):
        asked = trained(make_config(epochs=2, cuda_graphs=True), dataset, tmp_path / "asked")
    assert plain.model.read_bytes() == asked.model.read_bytes()
    lines = capsys.readouterr().err.splitlines()
    assert lines[0] == (
        "surrogate: warning: config 'small': 'training.cuda_graphs' is for one process on cuda, "
        "here 1 on cpu; training continues without it"
    )
    assert sum("warning" in line for line in lines) == 1


@pytest.mark.parametrize("name", ["adam", "muon"])
@pytest.mark.parametrize("weight_decay", [0.0, 0.1])
def test_learning_rate_as_a_tensor_gives_the_same_steps(name: str, weight_decay: float) -> None:
    """A tensor holds the rate in float32, so the steps agree to float32 round-off."""
    config = OptimiserConfig.model_validate({"name": name, "weight_decay": weight_decay})
    weights = []
    for capturable in (False, True):
        torch.manual_seed(0)
        network = UNet(2, 2, UNetConfig(levels=2, channels=8, batch_norm=False))
        optimisers = make_optimisers(network, config, capturable)
        for rate in (1e-2, 3e-3):
            set_learning_rate(optimisers, rate)
            network.zero_grad()
            network(torch.ones(2, 2, 8, 4)).square().sum().backward()
            for optimiser in optimisers:
                optimiser.step()
        rates = [group["lr"] for o in optimisers for group in o.param_groups]
        assert all(isinstance(rate, Tensor) == capturable for rate in rates)
        weights.append(torch.cat([p.detach().flatten() for p in network.parameters()]))
    torch.testing.assert_close(weights[1], weights[0], rtol=1e-5, atol=1e-6)


class RecordedGraph:
    """Replacement for a CUDA graph: it stores the work of a step, and runs it at every replay."""

    recording: RecordedGraph | None = None

    def __init__(self) -> None:
        self.work: Callable[[], object] = lambda: None

    def replay(self) -> None:
        self.work()


class NoStream:
    def wait_stream(self, other: NoStream) -> None: ...

    def __enter__(self) -> None: ...

    def __exit__(self, *_: object) -> None: ...


@pytest.mark.parametrize("posterior_std", ["gradient", "gauss_newton"])
def test_whole_batches_are_captured(
    dataset: Dataset,
    make_config: MakeConfig,
    monkeypatch: pytest.MonkeyPatch,
    posterior_std: str,
) -> None:
    """An epoch has 10 batches of 4 and one of 3; every fourth step estimates the information.

    Without a GPU, a captured step is replaced by the step itself, and its losses are the same to
    the rounding of the learning rate in float32.
    """
    config = make_config(
        likelihood="variational_bayes",
        variational={"posterior_std": posterior_std},
        batch_size=4,
        cuda_graphs=True,
    )
    captured: list[int] = []

    class StandIn:
        def __init__(self, work: Callable[[Samples], Tensor]) -> None:
            self.work, self.number = work, len(counts)
            counts.append(0)

        def __call__(self, samples: Samples) -> Tensor:
            counts[self.number] += 1
            captured.append(len(samples))
            return self.work(samples)

    counts: list[int] = []
    measures = []
    monkeypatch.setattr("surrogate.learning.training.trainer.CapturedStep", StandIn)
    for captures in (False, True):
        monkeypatch.setattr(
            "surrogate.learning.training.trainer.can_capture", lambda *_, c=captures: c
        )
        network = config.build(dataset.geometry, dataset.info)
        trainer = Trainer(config, network, dataset.train[:43], dataset.train[:0], ALONE)
        measures.append(trainer.train_epoch(0, Progress(trainer.steps, silent=True)))
    assert counts == [10, 3 if posterior_std == "gauss_newton" else 0]
    assert set(captured) == {4}
    assert measures[1] == pytest.approx(measures[0], rel=1e-4)


def train_on_cuda(config: Model, dataset: Dataset, folder: Path) -> RunFolder:
    run = RunFolder(folder)
    train(config, dataset, run.folder, device="cuda")
    return run


RECIPES: list[Any] = [
    pytest.param({"optimiser": "adam"}, id="adam"),
    pytest.param({"optimiser": "adam", "batch_norm": True}, id="batch-norm"),
    pytest.param({"optimiser": "muon", "gradient_clip": 0.1, "ema": 0.9}, id="muon"),
    pytest.param({"optimiser": "adam", "compile": True}, id="compiled"),
    pytest.param({"likelihood": "maximum_likelihood", "beta": 0.5}, id="likelihood"),
    pytest.param({"optimiser": "muon", "precision": "tensorfloat32"}, id="tensorfloat32"),
    pytest.param({"optimiser": "muon", "precision": "bfloat16"}, id="bfloat16"),
]


@pytest.mark.gpu
@pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device")
@pytest.mark.parametrize("recipe", RECIPES)
def test_captured_steps_train_as_the_others(
    tmp_path: Path, dataset: Dataset, make_config: MakeConfig, recipe: dict[str, Any]
) -> None:
    """An epoch has 10 full batches of 4 and one of 3; three steps are the warm-up."""
    runs = [
        train_on_cuda(
            make_config(epochs=4, batch_size=4, cuda_graphs=graphs, **recipe),
            dataset,
            tmp_path / str(graphs),
        )
        for graphs in (False, True)
    ]
    for line, expected in zip(untimed(runs[1]), untimed(runs[0]), strict=True):
        assert line == pytest.approx(expected, rel=1e-3)


@pytest.mark.gpu
@pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device")
def test_captured_run_goes_on_after_a_stop(
    tmp_path: Path, dataset: Dataset, make_config: MakeConfig
) -> None:
    config = make_config(epochs=4, batch_size=4, cuda_graphs=True)
    whole, parts = train_on_cuda(config, dataset, tmp_path / "whole"), RunFolder(tmp_path / "parts")
    train(config, dataset, parts.folder, device="cuda", stop_after=2)
    train(config, dataset, parts.folder, device="cuda")
    for line, expected in zip(untimed(parts), untimed(whole), strict=True):
        assert line == pytest.approx(expected, rel=1e-3)


@pytest.mark.gpu
@pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device")
@pytest.mark.parametrize("compiled", [False, True])
def test_every_replay_has_noise_of_its_own(
    dataset: Dataset, make_config: MakeConfig, compiled: bool
) -> None:
    """At a learning rate near zero, losses of a batch differ only by the noise, reproducibly."""
    config = make_config(
        likelihood="variational_bayes",
        variational={"initial_std": 0.1},
        learning_rate=1e-30,
        batch_size=4,
        cuda_graphs=True,
        compile=compiled,
    )
    network = config.build(dataset.geometry, dataset.info).cuda()
    few = dataset.train[:4]
    trainer = Trainer(config, network, few, few, ALONE)
    batch = few.to(torch.device("cuda"))
    assert trainer.captured_step is not None

    def losses(count: int) -> list[float]:
        torch.manual_seed(0)
        return [float(trainer.captured_step(batch)[0]) for _ in range(count)]  # type: ignore[misc]

    losses(cuda_graph.WARM_UP + 1)
    first = losses(8)
    assert len(set(first)) == 8
    assert losses(8) == pytest.approx(first, rel=1e-5)
