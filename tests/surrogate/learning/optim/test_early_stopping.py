from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch
from safetensors.torch import load_file
from torch import nn

from shared_schema.common.errors import InputError
from surrogate.learning.data.dataset import Dataset
from surrogate.learning.data.samples import Samples
from surrogate.learning.models.kinds import run_config
from surrogate.learning.models.unet_model import UNetModel
from surrogate.learning.optim.final_weights import EarlyStopping
from surrogate.learning.optim.optimisers import EarlyStoppingConfig
from surrogate.learning.runs.folder import RunFolder
from surrogate.learning.training.loop import train
from surrogate.learning.training.trainer import Trainer
from tests.surrogate.resuming import assert_resumes, trained, untimed

MakeConfig = Callable[..., UNetModel]
LOSSES = (5.0, 3.0, 4.0, 3.0, math.nan, 2.0, 2.5, 2.4, 2.3, 1.0)


def test_best_epoch_by_hand() -> None:
    """`LOSSES` improves in epochs 1, 2 and 6; with a patience of 3, training ends after epoch 9."""
    network = nn.Linear(1, 1)
    stopping = EarlyStopping(EarlyStoppingConfig(patience=3))
    best, over = [], []
    for epoch, loss in enumerate(LOSSES[:9], start=1):
        nn.init.constant_(network.weight, float(epoch))
        stopping.observe(epoch, loss, network)
        best.append(stopping.best_epoch)
        over.append(stopping.is_over(epoch))
    assert best == [1, 2, 2, 2, 2, 6, 6, 6, 6]
    assert over == [False] * 4 + [True] + [False] * 3 + [True]
    assert stopping.best["weight"].item() == 6.0


@pytest.fixture
def _losses(monkeypatch: pytest.MonkeyPatch) -> None:
    """Replace the validation losses of the epochs by given numbers."""
    finish = Trainer.finish_epoch

    def given(self: Trainer, epoch: int, measures: Any) -> None:
        finish(self, epoch, {**measures, "validation_loss": LOSSES[epoch - 1]})

    monkeypatch.setattr(Trainer, "finish_epoch", given)


@pytest.mark.usefixtures("_losses")
def test_weights_of_the_best_epoch_become_the_model(
    tmp_path: Path, dataset: Dataset, make_config: MakeConfig
) -> None:
    """With a patience of 2, the second epoch is the best one, and the fourth the last."""
    config = make_config(epochs=10, early_stopping={"patience": 2})
    run, second = trained(config, dataset, tmp_path / "run"), RunFolder(tmp_path / "second")
    assert [line["epoch"] for line in run.metric_lines()] == [1, 2, 3, 4]
    train(config, dataset, second.folder, device="cpu", stop_after=2)
    model, then = load_file(run.model), load_file(second.checkpoint)
    weights = {k.removeprefix("network."): v for k, v in then.items() if k.startswith("network.")}
    assert len(weights) > 10
    for name, value in weights.items():
        assert torch.equal(model[name], value), name
    last = load_file(run.checkpoint)
    assert not torch.equal(model["network.head.weight"], last["network.network.head.weight"])


@pytest.mark.usefixtures("_losses")
@pytest.mark.parametrize("stop_after", [1, 3])
@pytest.mark.parametrize("ema", [None, 0.9])
def test_stops_in_the_same_epoch_after_a_stop(
    tmp_path: Path, dataset: Dataset, make_config: MakeConfig, stop_after: int, ema: float | None
) -> None:
    config = make_config(epochs=10, early_stopping={"patience": 2}, ema=ema)
    assert_resumes(config, dataset, tmp_path, stop_after)


@pytest.mark.usefixtures("_losses")
def test_killed_before_the_model_was_written(
    tmp_path: Path, dataset: Dataset, make_config: MakeConfig
) -> None:
    """The checkpoint shows that the training is over; no epoch is added."""
    config = make_config(epochs=10, early_stopping={"patience": 2})
    run = trained(config, dataset, tmp_path / "run")
    before, lines = run.model.read_bytes(), untimed(run)
    run.seal.withdraw([run.model])
    train(config, dataset, run.folder, device="cpu")
    assert run.model.read_bytes() == before
    assert untimed(run) == lines


def test_best_weights_without_an_early_stop(
    tmp_path: Path, dataset: Dataset, make_config: MakeConfig
) -> None:
    """If the patience exceeds the epochs, all epochs run, and the best weights are kept."""
    config = make_config(epochs=5, learning_rate=0.3, early_stopping={"patience": 9})
    run = trained(config, dataset, tmp_path / "run")
    losses = [line["validation_loss"] for line in run.metric_lines()]
    assert len(losses) == 5
    checkpoint = load_file(run.checkpoint)
    assert checkpoint["early_stopping.best_loss"].item() == min(losses)
    assert checkpoint["early_stopping.best_epoch"].item() == losses.index(min(losses)) + 1


def test_test_split_has_no_part(tmp_path: Path, dataset: Dataset, make_config: MakeConfig) -> None:
    """If every test sample is NaN, the run is the same."""
    config = make_config(epochs=3, early_stopping={"patience": 1})
    known = (each for each in vars(dataset.test).values() if each is not None)
    unknown = Samples(*(torch.full_like(each, math.nan) for each in known))
    one = trained(config, dataset, tmp_path / "one")
    other = trained(config, replace(dataset, test=unknown), tmp_path / "other")
    assert one.model.read_bytes() == other.model.read_bytes()


@pytest.mark.parametrize(
    ("training", "part"),
    [
        ({"early_stopping": {"patience": 0}}, "key 'training.early_stopping.patience' = 0"),
        (
            {"early_stopping": {"patience": 3}},
            "key 'training': early_stopping expects validation_fraction > 0, found 0",
        ),
    ],
)
def test_wrong_keys_are_named(training: dict[str, Any], part: str) -> None:
    content = {"name": "a", "case": "b", "training": training}
    with pytest.raises(InputError) as error:
        run_config(content, "a.yaml")
    assert str(error.value).startswith(f"a.yaml: {part}")
    assert "\n" not in str(error.value)


def test_validation_part_without_samples_is_refused(
    tmp_path: Path, dataset: Dataset, make_config: MakeConfig
) -> None:
    """A hundredth of 48 samples rounds to zero samples."""
    config = make_config(validation_fraction=0.01, early_stopping={"patience": 3})
    run = RunFolder(tmp_path / "run")
    with pytest.raises(
        InputError,
        match=r"'training.validation_fraction' = 0.01 takes none of 48 samples, but "
        r"'training.early_stopping' expects some",
    ):
        train(config, dataset, run.folder, device="cpu")
    assert not run.folder.exists()
