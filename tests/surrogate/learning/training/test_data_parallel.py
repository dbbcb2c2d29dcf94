"""Training with two processes on gloo equals that with one, to float32 round-off."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch
import yaml
from safetensors.torch import load_file
from torch import Tensor

from shared_schema.common.errors import InputError
from surrogate.learning.data.dataset import Dataset
from surrogate.learning.models.model import Model, TrainedModel
from surrogate.learning.models.unet_model import UNetModel
from surrogate.learning.runs.description import describe
from surrogate.learning.runs.folder import RunFolder
from surrogate.learning.training.data_parallel import ALONE, Ranks, joined
from surrogate.learning.training.trainer import Trainer
from tests.surrogate.resuming import CPU, trained, untimed

MakeConfig = Callable[..., UNetModel]

# A quarter of the 48 samples is for validation. The other 36 make 5 batches of 7 and one of 1. The
# shares of two processes are 4 and 3 samples, and in the last batch 1 and 0.
UNEVEN: dict[str, Any] = {"batch_size": 7, "validation_fraction": 0.25}


def test_parts_of_a_batch() -> None:
    batch = torch.tensor([5, 3, 8, 1, 9])
    parts = [Ranks(rank, 3).share(batch).tolist() for rank in range(3)]
    assert parts == [[5, 3], [8, 1], [9]]
    assert [Ranks(rank, 2).share(batch[:1]).tolist() for rank in range(2)] == [[5], []]
    assert ALONE.share(batch).tolist() == batch.tolist()


def test_without_torchrun_there_is_one() -> None:
    with joined("cpu") as (ranks, device):
        assert (ranks, device) == (ALONE, CPU)
        assert ranks.from_first(lambda: 7) == 7


def test_more_processes_than_devices(monkeypatch: pytest.MonkeyPatch) -> None:
    environment = {"TORCHELASTIC_RUN_ID": "a", "LOCAL_RANK": "2", "LOCAL_WORLD_SIZE": "4"}
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    monkeypatch.setattr(torch.cuda, "device_count", lambda: 2)
    with pytest.raises(InputError, match="--nproc-per-node 4: expected 2 at most"), joined("cuda"):
        pass


def gradients(
    config: TrainedModel, dataset: Dataset, ranks: Ranks, count: int
) -> tuple[Tensor, ...]:
    """Return all gradients and loss terms of a rank's share of the first `count` samples."""
    network = config.build(dataset.geometry, dataset.info)
    trainer = Trainer(config, network, dataset.train, dataset.train, ranks)
    if trainer.elbo is not None:
        trainer.elbo.factor.fill_(0.5)
    terms = trainer.differentiate(dataset.train[ranks.share(torch.arange(count))], count)
    flat = [(torch.zeros_like(p) if p.grad is None else p.grad) for p in network.parameters()]
    return torch.cat([gradient.flatten() for gradient in flat]), terms


@pytest.mark.parametrize("count", [1, 2, 5, 16])
@pytest.mark.parametrize("processes", [2, 3])
@pytest.mark.parametrize("likelihood", ["deterministic", "maximum_likelihood", "variational_bayes"])
def test_parts_of_the_gradient_add_up(
    dataset: Dataset, make_config: MakeConfig, likelihood: str, processes: int, count: int
) -> None:
    """Shares of the gradients of loss and KL divergence (counted once) add up; noise is negligible.

    The gradient of the KL divergence, of the order of σ_p / σ, is far larger than that of the loss.
    """
    config = make_config(likelihood=likelihood, variational={"initial_std": 1e-7})
    gradient, terms = gradients(config, dataset, ALONE, count)
    parts = [gradients(config, dataset, Ranks(r, processes), count) for r in range(processes)]
    scale = float(gradient.abs().max())
    total = torch.stack([part for part, _ in parts]).sum(0)
    torch.testing.assert_close(total, gradient, rtol=1e-4, atol=1e-5 * scale)
    torch.testing.assert_close(torch.stack([t for _, t in parts]).sum(0), terms, rtol=1e-4, atol=0)


def test_noise_differs_by_rank(
    dataset: Dataset, make_config: MakeConfig, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The noise of the first rank equals that of a single process."""
    seeds: list[int] = []
    monkeypatch.setattr(torch, "manual_seed", seeds.append)
    config = make_config(epochs=1, batch_size=64)
    description = describe(config, dataset)
    for ranks in (ALONE, Ranks(0, 2), Ranks(1, 2)):
        monkeypatch.setattr(Ranks, "add_up", lambda *_: None)
        monkeypatch.setattr(Ranks, "add_up_gradients", lambda *_: None)
        network = description.run.build(dataset.geometry, dataset.info)
        trainer = Trainer(config, network, dataset.train, dataset.test, ranks)
        trainer.train_epoch(0, _NoProgress())  # type: ignore[arg-type]
    noise = seeds[1::2]  # all other seeds are for the initial weights
    assert noise[0] == noise[1] != noise[2]


class _NoProgress:
    def update(self, done: int, note: str = "") -> None: ...


def torchrun(
    config: Model, data: Path, run: Path, *options: str
) -> subprocess.CompletedProcess[str]:
    """Train with two processes; the configuration file is beside the run folder."""
    path = run.with_suffix(".yaml")
    path.write_text(yaml.safe_dump(config.plain()))
    return subprocess.run(
        [
            *(sys.executable, "-m", "torch.distributed.run", "--standalone"),
            *("--nproc-per-node", "2", "-m", "surrogate.command_line", "train", str(path)),
            *("--data", str(data), "--out", str(run), "--device", "cpu", *options),
        ],
        env={**os.environ, "OMP_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
        timeout=300,
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    "recipe",
    [
        pytest.param({"optimiser": "adam", "gradient_clip": 0.5}, id="adam"),
        pytest.param(
            {
                "optimiser": "muon",
                "ema": 0.9,
                "likelihood": "variational_bayes",
                "variational": {"initial_std": 1e-6},
            },
            id="muon-bayes",
        ),
    ],
)
def test_two_processes_train_as_one(
    tmp_path: Path,
    dataset: Dataset,
    data: Path,
    make_config: MakeConfig,
    recipe: dict[str, Any],
) -> None:
    """The batches are the same, and so are losses, weights and files; one process writes."""
    config = make_config(epochs=3, **UNEVEN, **recipe)
    one, two = trained(config, dataset, tmp_path / "one"), RunFolder(tmp_path / "two")
    done = torchrun(config, data, two.folder)
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("trained, 3 of 3 epochs") == 1
    assert [line["epoch"] for line in two.metric_lines()] == [1, 2, 3]
    for line, expected in zip(untimed(two), untimed(one), strict=True):
        assert line == pytest.approx(expected, rel=1e-4)
    first, second = load_file(one.model), load_file(two.model)
    for name, value in first.items():
        torch.testing.assert_close(second[name], value, rtol=1e-3, atol=1e-4)


@pytest.mark.slow
def test_two_processes_go_on_after_a_stop(
    tmp_path: Path, data: Path, make_config: MakeConfig
) -> None:
    """Resuming with two processes is exact, bit for bit, also with early stopping."""
    config = make_config(epochs=6, early_stopping={"patience": 5}, **UNEVEN)
    whole, parts = RunFolder(tmp_path / "whole"), RunFolder(tmp_path / "parts")
    for run, options in ((whole, ()), (parts, ("--stop-after", "2")), (parts, ())):
        done = torchrun(config, data, run.folder, *options)
        assert done.returncode == 0, done.stderr
    assert whole.model.read_bytes() == parts.model.read_bytes()
    assert untimed(whole) == untimed(parts)


@pytest.mark.slow
def test_what_one_process_refuses_all_do(
    tmp_path: Path, data: Path, make_config: MakeConfig
) -> None:
    """The error is one line without a traceback; torchrun adds its own lines."""

    def refused(config: Model, run: Path, part: str) -> None:
        done = torchrun(config, data, run)
        assert done.returncode != 0
        ours = [line for line in done.stderr.splitlines() if line.startswith("surrogate: error:")]
        assert len(ours) == 1
        assert part in ours[0]
        assert "InputError" not in done.stderr

    run = tmp_path / "run"
    refused(make_config(batch_size=1), run, "'training.batch_size' = 1, expected 2 at least")
    assert not run.exists()
    run.mkdir()
    (run / "other").touch()
    refused(make_config(), run, "holds something else")
    assert [path.name for path in run.iterdir()] == ["other"]
