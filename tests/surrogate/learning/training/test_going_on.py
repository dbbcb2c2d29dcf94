"""A training that has ended goes on with more epochs."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
import torch
import yaml
from safetensors.torch import load_file

import surrogate
from shared_schema.common.command_line import logged
from shared_schema.common.errors import InputError
from surrogate.learning.data.dataset import Dataset
from surrogate.learning.models.unet_model import UNetModel
from surrogate.learning.runs.folder import RunFolder
from surrogate.learning.training.loop import train
from surrogate.learning.training.training_log import going_on
from tests.surrogate.resuming import untimed

CPU = torch.device("cpu")
MakeConfig = Callable[..., UNetModel]


def test_at_a_constant_rate_it_is_one_training(
    tmp_path: Path, dataset: Dataset, make_config: MakeConfig, capsys: pytest.CaptureFixture[str]
) -> None:
    """2 + 2 + 1 epochs are 5, bit for bit: weights, states of the optimiser, averages, measures."""
    same = {"schedule": {"name": "constant"}, "ema": 0.9}
    whole, parts = RunFolder(tmp_path / "whole"), RunFolder(tmp_path / "parts")
    train(make_config(epochs=5, **same), dataset, whole.folder, device="cpu")
    for epochs in (2, 4, 5):
        assert not parts.is_finished or parts.description().epochs != epochs
        with logged("surrogate"):
            train(make_config(epochs=epochs, **same), dataset, parts.folder, device="cpu")
        assert parts.is_finished
    assert parts.description().went_on_from == (2, 4)
    assert untimed(whole) == untimed(parts)
    one, other = load_file(whole.checkpoint), load_file(parts.checkpoint)
    assert all(torch.equal(one[name], other[name]) for name in one)
    assert whole.model.read_bytes() == parts.model.read_bytes()
    assert "going on from epoch 4 to 5; the learning rate goes on at 1" in capsys.readouterr().err
    assert "went_on_from" not in yaml.safe_load(whole.config.read_text())


def test_a_decayed_rate_starts_again(make_config: MakeConfig) -> None:
    """Linear decay to zero over 30 epochs of 10 steps; 30 of 40 epochs leave a quarter."""
    config = make_config(epochs=40, schedule={"name": "linear"})
    said = going_on(config, 30, 10)
    assert (
        "the learning rate, 0.00333 of its peak at the end, starts again at 0.25, as after" in said
    )
    assert "30 of 40 epochs; the weights are not those of 40 at once" in said


def test_until_its_new_end_it_is_not_finished(
    tmp_path: Path, evaluated: Path, dataset: Dataset
) -> None:
    """The evaluation was that of other weights. The same command resumes."""
    run = RunFolder(Path(shutil.copytree(evaluated, tmp_path / "run")))
    config = run.description().run
    longer = run.description().with_epochs(43).run
    train(longer, dataset, run.folder, device="cpu", stop_after=41)
    assert not run.is_finished
    assert run.mean_error() is None
    with pytest.raises(InputError, match="the run is not finished"):
        surrogate.load(run.folder)
    with pytest.raises(InputError, match=r"run\.training\.epochs = 40, the folder has 43"):
        train(config, dataset, run.folder, device="cpu")
    with pytest.raises(InputError, match=r"run\.training\.epochs = 50, the folder has 43"):
        train(run.description().with_epochs(50).run, dataset, run.folder, device="cpu")
    train(longer, dataset, run.folder, device="cpu")
    assert [line["epoch"] for line in run.metric_lines()][-1] == 43
    assert run.description().went_on_from == (40,)
    with pytest.raises(InputError, match="not evaluated yet"):
        run.read_evaluation()
    train(longer, dataset, run.folder, device="cpu")


def test_killed_while_it_begins_to_go_on(
    tmp_path: Path, trained: Path, dataset: Dataset, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Between the two manifests, before or after the new configuration."""
    for number, name in enumerate(("_write_config", "keep_metric_lines")):
        run = RunFolder(Path(shutil.copytree(trained, tmp_path / str(number))))
        before = run.description()
        longer = before.with_epochs((before.epochs or 0) + 1).run

        def killed(*_: object) -> None:
            raise KeyboardInterrupt

        with monkeypatch.context() as patch:
            patch.setattr(RunFolder, name, killed)
            with pytest.raises(KeyboardInterrupt):
                train(longer, dataset, run.folder, device="cpu")
        assert not run.is_finished
        train(longer, dataset, run.folder, device="cpu")
        assert run.is_finished
        assert run.description().went_on_from == (before.epochs,)


def test_refusals(tmp_path: Path, trained: Path, dataset: Dataset, make_config: MakeConfig) -> None:
    run = RunFolder(Path(shutil.copytree(trained, tmp_path / "run")))
    longer = run.description().with_epochs(100).run
    with pytest.raises(InputError, match=r"another run\.seed = 7"):
        train(longer.model_copy(update={"seed": 7}), dataset, run.folder, device="cpu")
    run.checkpoint.unlink()
    with pytest.raises(InputError, match=r"no last\.safetensors to go on from; `--start-from"):
        train(longer, dataset, run.folder, device="cpu")
    stopped = RunFolder(tmp_path / "stopped")
    patience = {"early_stopping": {"patience": 1}, "learning_rate": 1e-30, "optimiser": "adam"}
    train(make_config(epochs=9, **patience), dataset, stopped.folder, device="cpu")
    with pytest.raises(
        InputError, match="early stopping has ended the training after epoch 2 of 9"
    ):
        train(make_config(epochs=10, **patience), dataset, stopped.folder, device="cpu")
