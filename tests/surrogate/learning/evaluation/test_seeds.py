"""Several seeds of one configuration: resumed, refused; mean and spread by hand."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml

from surrogate.command_line import main
from surrogate.learning.data.dataset import Dataset
from surrogate.learning.evaluation.seeds import spread
from surrogate.learning.models.unet_model import UNetModel
from surrogate.learning.runs.folder import RunFolder
from surrogate.learning.training.trainer import Trainer
from tests.surrogate.resuming import trained, untimed


@pytest.fixture
def train_seeds(tmp_path: Path, data: Path, make_config: Callable[..., UNetModel]) -> list[str]:
    """Command that trains the small network; what comes after --seeds is missing."""
    config = tmp_path / "small.yaml"
    config.write_text(yaml.safe_dump(make_config(epochs=3).plain()))
    given = ("--data", str(data), "--out", str(tmp_path / "runs"), "--device", "cpu")
    return ["train", str(config), *given, "--seeds"]


def test_seeds_resume_and_are_added(
    train_seeds: list[str],
    tmp_path: Path,
    data: Path,
    dataset: Dataset,
    make_config: Callable[..., UNetModel],
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Stopped by time in seed 0, killed in seed 1, a seed more: as trained alone. The spread."""
    runs = tmp_path / "runs"
    assert main([*train_seeds, "0:2", "--seconds", "1e-9"]) == 0
    assert [path.name for path in runs.iterdir()] == ["seed-0"]
    assert len(RunFolder(runs / "seed-0").metric_lines()) == 1
    evaluate = ["evaluate", str(runs), "--data", str(data), "--device", "cpu"]
    assert main(evaluate) == 2
    assert "seed-0: the run is not finished" in capsys.readouterr().err
    step, steps = Trainer.train_epoch, iter(range(4))  # two of seed 0, two of seed 1

    def killed(self: Trainer, *arguments: Any) -> dict[str, float]:
        if next(steps) == 3:
            raise KeyboardInterrupt
        return step(self, *arguments)

    with monkeypatch.context() as patch:
        patch.setattr(Trainer, "train_epoch", killed)
        assert main([*train_seeds, "0:2"]) == 1
    assert "stopped; resume with the same command" in capsys.readouterr().err
    assert not RunFolder(runs / "seed-1").is_finished
    assert main([*train_seeds, "0:2"]) == 0
    written = RunFolder(runs / "seed-1").model.stat().st_mtime_ns
    assert main([*train_seeds, "1:3"]) == 0
    assert RunFolder(runs / "seed-1").model.stat().st_mtime_ns == written
    for seed in range(3):
        config = make_config(epochs=3).model_copy(update={"seed": seed})
        alone, one = (
            trained(config, dataset, tmp_path / str(seed)),
            RunFolder(runs / f"seed-{seed}"),
        )
        assert alone.model.read_bytes() == one.model.read_bytes()
        assert untimed(alone) == untimed(one)
    capsys.readouterr()
    assert main(evaluate) == 0
    said = capsys.readouterr().out.splitlines()[-1]
    a, b, c = (
        RunFolder(runs / f"seed-{seed}").read_evaluation()["test"]["mean_error"]
        for seed in range(3)
    )
    mean = (a + b + c) / 3
    std = (((a - mean) ** 2 + (b - mean) ** 2 + (c - mean) ** 2) / 2) ** 0.5
    found = json.loads((runs / "seeds.json").read_text())
    assert found["seeds"] == [0, 1, 2]
    assert found["mean_error"]["mean"] == pytest.approx(mean)
    assert found["mean_error"]["std"] == pytest.approx(std)
    assert (found["mean_error"]["min"], found["mean_error"]["max"]) == (min(a, b, c), max(a, b, c))
    assert f"3 seeds, mean error [m]: mean {mean:.3g}, standard deviation {std:.2g}" in said
    assert std > 1e-3 * mean


def test_spread_by_hand() -> None:
    """Of 1, 2 and 6: mean 3, variance (4 + 1 + 9) / 2 = 7. One seed has no standard deviation."""

    def evaluation(seed: int, error: float) -> dict[str, object]:
        intervals = [{"level": 0.95, "coverage": error / 10}]
        test = {"samples": 12, "mean_error": error}
        given = {"seed": seed, "test": test, "training_seconds": 2 * error}
        return given | {"uncertainty": {"intervals": intervals}}

    found = spread([evaluation(0, 1.0), evaluation(3, 2.0), evaluation(4, 6.0)])
    assert found["seeds"] == [0, 3, 4]
    assert found["mean_error"] == {"mean": 3.0, "std": pytest.approx(7**0.5), "min": 1, "max": 6}
    assert found["coverage_95"]["mean"] == pytest.approx(0.3)
    assert found["training_seconds"]["std"] == pytest.approx(2 * 7**0.5)
    assert spread([evaluation(0, 1.0)])["mean_error"]["std"] is None


@pytest.mark.parametrize("text", ["5:0", "a:b", "2", "0:", "3:3", "-1:2", "0:1:2", "²:3"])
def test_wrong_seeds(text: str, train_seeds: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main([*train_seeds[:-1], f"--seeds={text}"])
    assert ended.value.code == 2
    assert f"'{text}': expected seeds A:B" in capsys.readouterr().err


def test_refused_folders_and_keys(
    train_seeds: list[str],
    tmp_path: Path,
    data: Path,
    trained: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """A folder of one run, a seed twice, and seeds that are of two configurations."""
    elsewhere = [str(trained) if word == str(tmp_path / "runs") else word for word in train_seeds]
    assert main([*elsewhere, "0:2"]) == 2
    assert "a run, expected a folder for the runs of --seeds" in capsys.readouterr().err
    assert main([*train_seeds, "0:2", "--set", "seed=3"]) == 2
    assert "--set seed and --seeds: expected one of them" in capsys.readouterr().err
    assert not (tmp_path / "runs").exists()
    assert main([*train_seeds, "0:1"]) == 0
    assert main([*train_seeds, "1:2", "--set", "training.epochs=1"]) == 0
    capsys.readouterr()
    assert main(["evaluate", str(tmp_path / "runs"), "--data", str(data)]) == 2
    said = capsys.readouterr().err
    assert "seed-1: another training.epochs = 1, seed-0 has 3; expected runs that differ" in said
    assert said.count("\n") == 1
