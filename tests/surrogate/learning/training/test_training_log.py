from __future__ import annotations

import importlib.util
from collections.abc import Callable
from pathlib import Path

import pytest
import yaml

from surrogate.command_line import main
from surrogate.learning.data.dataset import Dataset
from surrogate.learning.models.unet_model import UNetModel
from surrogate.learning.runs.folder import RunFolder
from surrogate.learning.training.loop import train
from tests.surrogate.resuming import trained

MakeConfig = Callable[..., UNetModel]
NAMES = {
    "epoch",
    "train_loss",
    "validation_loss",
    "validation_error",
    "validation_relative_error",
    "learning_rate",
    "seconds",
    "samples_per_second",
}


def test_what_a_line_has(tmp_path: Path, dataset: Dataset, make_config: MakeConfig) -> None:
    """43 training samples in batches of 16 make 3 steps; linear decay without warm-up."""
    config = make_config(epochs=2, learning_rate=0.01, schedule={"name": "linear"})
    lines = trained(config, dataset, tmp_path / "run").metric_lines()
    assert all(set(line) == NAMES for line in lines)
    # rates of steps 2 and 5 of 6, relative to the peak: 1 - 2/6 and 1 - 5/6
    assert [line["learning_rate"] for line in lines] == pytest.approx([0.01 * 4 / 6, 0.01 / 6])
    assert 0 < lines[0]["seconds"] < lines[1]["seconds"]
    for line, seconds in zip(lines, (lines[0]["seconds"], lines[1]["seconds"]), strict=True):
        assert line["samples_per_second"] >= 43 / seconds


def test_terms_of_a_variational_network(
    tmp_path: Path, dataset: Dataset, make_config: MakeConfig
) -> None:
    """Loss per datum = negative log-likelihood + factor · KL divergence, with factor 1/2."""
    config = make_config(
        epochs=2, likelihood="variational_bayes", variational={"weight": 0.5, "prior_std": 0.5}
    )
    for line in trained(config, dataset, tmp_path / "run").metric_lines():
        assert set(line) == NAMES | {"negative_log_likelihood", "kl_divergence"}
        assert line["kl_divergence"] > 0
        assert line["train_loss"] == pytest.approx(
            line["negative_log_likelihood"] + 0.5 * line["kl_divergence"], rel=1e-5
        )


def scalars(folder: Path) -> dict[str, list[tuple[int, float]]]:
    """Return all series that TensorBoard reads from a folder."""
    from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

    events = EventAccumulator(str(folder))
    events.Reload()
    return {
        name: [(event.step, event.value) for event in events.Scalars(name)]
        for name in events.Tags()["scalars"]
    }


@pytest.mark.slow
def test_tensorboard_shows_the_lines(
    tmp_path: Path, dataset: Dataset, make_config: MakeConfig
) -> None:
    """After a stop and a resume, every line still occurs only once."""
    config, run = make_config(epochs=4), RunFolder(tmp_path / "run")
    train(config, dataset, run.folder, device="cpu", stop_after=2, tensorboard=True)
    train(config, dataset, run.folder, device="cpu", tensorboard=True)
    lines, shown = run.metric_lines(), scalars(run.tensorboard)
    assert set(shown) == NAMES - {"epoch"}
    for name, series in shown.items():
        assert [step for step, _ in series] == [1, 2, 3, 4]
        values = [value for _, value in series]
        assert values == pytest.approx([line[name] for line in lines], rel=1e-6)


def test_missing_tensorboard_is_one_line(
    tmp_path: Path,
    data: Path,
    make_config: MakeConfig,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda _: None)
    config = tmp_path / "config.yaml"
    config.write_text(yaml.safe_dump(make_config().plain()))
    run = tmp_path / "run"
    arguments = ["train", str(config), "--data", str(data), "--out", str(run), "--device", "cpu"]
    assert main([*arguments, "--tensorboard"]) == 2
    assert capsys.readouterr().err == (
        "surrogate: error: --tensorboard: not installed, expected the package 'tensorboard'\n"
    )
    assert not run.exists()
