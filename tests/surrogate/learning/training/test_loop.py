from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
import yaml
from safetensors.torch import load_file
from torch import Tensor

import surrogate
from shared_schema.common.command_line import logged
from shared_schema.common.errors import InputError, WorkError
from shared_schema.common.progress import shown_progress
from shared_schema.grid import Grid
from surrogate.learning.data.dataset import Dataset
from surrogate.learning.data.joined_dataset import read_dataset
from surrogate.learning.inference.loading import load
from surrogate.learning.measures.error_metrics import measure
from surrogate.learning.models.model import TrainedModel
from surrogate.learning.models.unet_model import UNetModel
from surrogate.learning.optim.optimisers import ScheduleConfig
from surrogate.learning.runs.folder import RunFolder
from surrogate.learning.runs.seal import append_line
from surrogate.learning.runs.split import split_training
from surrogate.learning.training.loop import train
from surrogate.learning.training.setup import split_for
from surrogate.runtime.device import choose_device, stream

CPU = torch.device("cpu")
MakeConfig = Callable[..., UNetModel]


def untimed(run: RunFolder) -> list[dict[str, Any]]:
    times = ("seconds", "samples_per_second")
    return [{k: v for k, v in line.items() if k not in times} for line in run.metric_lines()]


def assert_same_run(first: RunFolder, second: RunFolder) -> None:
    """Require equal weights, optimiser states and measures, bit for bit."""
    assert first.model.read_bytes() == second.model.read_bytes()
    one, other = load_file(first.checkpoint), load_file(second.checkpoint)
    assert list(one) == list(other)
    assert any(name.startswith("optimiser.") for name in one)
    for name in one:
        assert torch.equal(one[name], other[name]), name
    assert untimed(first) == untimed(second)


RECIPES: list[Any] = [
    pytest.param({"optimiser": "adam", "batch_norm": True}, id="adam-batch-norm"),
    pytest.param({"optimiser": "muon"}, id="muon"),
]


PROBABILISTIC: list[Any] = [
    pytest.param({"likelihood": "maximum_likelihood", "beta": 0.5}, id="maximum-likelihood"),
    pytest.param(
        {"likelihood": "variational_bayes", "variational": {"biases": True, "warmup": 0.6}},
        id="closed-divergence",
    ),
    pytest.param(
        {
            "likelihood": "variational_bayes",
            "variational": {"kl_divergence": "sampled", "biases": True, "prior_mean": "zero"},
            "optimiser": "adam",
            "batch_norm": True,
        },
        id="sampled-divergence",
    ),
]


@pytest.mark.parametrize("recipe", RECIPES + PROBABILISTIC)
def test_k_and_k_epochs_are_2k(
    tmp_path: Path,
    dataset: Dataset,
    dataset_3d: Dataset,
    make_config: MakeConfig,
    recipe: dict[str, Any],
) -> None:
    """Some in the plane, some in space."""
    dimension = 3 if recipe.get("batch_norm") else 2
    samples = {2: dataset, 3: dataset_3d}[dimension]
    config = make_config(dimension=dimension, epochs=4, **recipe)
    whole, parts = RunFolder(tmp_path / "whole"), RunFolder(tmp_path / "parts")
    train(config, samples, whole.folder, device="cpu")
    train(config, samples, parts.folder, device="cpu", stop_after=2)
    assert not parts.model.is_file()
    assert [line["epoch"] for line in parts.metric_lines()] == [1, 2]
    train(config, samples, parts.folder, device="cpu")
    assert [line["epoch"] for line in parts.metric_lines()] == [1, 2, 3, 4]
    assert_same_run(whole, parts)


def test_epochs_within_a_time(tmp_path: Path, dataset: Dataset, make_config: MakeConfig) -> None:
    """Within a nanosecond, every call trains one epoch; the result is that of a single call."""
    config = make_config(epochs=3)
    whole, parts = RunFolder(tmp_path / "whole"), RunFolder(tmp_path / "parts")
    train(config, dataset, whole.folder, device="cpu", seconds=1000.0)
    for epochs in (1, 2, 3):
        assert not parts.model.is_file()
        train(config, dataset, parts.folder, device="cpu", seconds=1e-9)
        assert len(parts.metric_lines()) == epochs
    assert_same_run(whole, parts)


def test_from_python(data: Path, tmp_path: Path, make_config: MakeConfig) -> None:
    """From a mapping and a folder; a stopped training returns its network so far."""
    config, force = make_config(epochs=2).plain(), np.zeros((32, 2))
    force[31, 1] = 1.0
    stopped = surrogate.train(config, data, tmp_path / "run", stop_after=1, device="cpu")
    with pytest.raises(InputError, match="the run is not finished"):
        surrogate.load(tmp_path / "run")
    finished = surrogate.train(config, data, tmp_path / "run", device="cpu")
    loaded = surrogate.load(tmp_path / "run")
    assert np.array_equal(finished.predict(force), loaded.predict(force))
    assert not np.array_equal(stopped.predict(force), loaded.predict(force))
    evaluation = surrogate.evaluate(tmp_path / "run", data, device="cpu")
    assert "12 test samples, mean error" in repr(evaluation)
    assert surrogate.compare([evaluation.write()], device="cpu").runs[0].samples == 12


@pytest.mark.parametrize("seconds", [0.0, -1.0, float("nan")])
def test_no_time_to_train_within(
    tmp_path: Path, dataset: Dataset, make_config: MakeConfig, seconds: float
) -> None:
    with pytest.raises(InputError, match=f"seconds {seconds:g}: expected more than 0"):
        train(make_config(), dataset, tmp_path / "run", device="cpu", seconds=seconds)
    assert not (tmp_path / "run").exists()


def test_scales_by_node_are_resumed(
    tmp_path: Path, dataset: Dataset, make_config: MakeConfig
) -> None:
    config = make_config(epochs=4, loss="mae").model_copy(update={"displacement_scale": "node"})
    whole, parts = RunFolder(tmp_path / "whole"), RunFolder(tmp_path / "parts")
    train(config, dataset, whole.folder, device="cpu")
    train(config, dataset, parts.folder, device="cpu", stop_after=3)
    train(config, dataset, parts.folder, device="cpu")
    assert_same_run(whole, parts)
    scale = load_file(whole.model)["displacement_scale"]
    assert len(set(scale.flatten().tolist())) > 10


@pytest.mark.faults
@pytest.mark.slow
@pytest.mark.parametrize("recipe", RECIPES)
def test_killed_process_goes_on_as_if_nothing_had_been(
    tmp_path: Path, data: Path, make_config: MakeConfig, recipe: dict[str, Any]
) -> None:
    config = make_config(epochs=6, checkpoint_seconds=0.0, **recipe)
    killed, whole = RunFolder(tmp_path / "killed"), RunFolder(tmp_path / "whole")
    path = tmp_path / "config.yaml"
    path.write_text(yaml.safe_dump(config.plain()))
    train_and_wait = [
        *("import sys, time", "from surrogate.command_line import main"),
        *("from surrogate.learning.training import trainer", "epoch = trainer.Trainer.train_epoch"),
        "wait = lambda: (print('ready', flush=True), time.sleep(600))",
        "trainer.Trainer.train_epoch = lambda *a: wait() if a[1] == 3 else epoch(*a)",
        "main(sys.argv[1:])",
    ]
    process = subprocess.Popen(
        [
            *(sys.executable, "-c", "\n".join(train_and_wait), "train", str(path)),
            *("--data", str(data), "--out", str(killed.folder), "--device", "cpu"),
        ],
        env={**os.environ, "OMP_NUM_THREADS": "1"},
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
    )
    try:
        assert process.stdout is not None
        assert process.stdout.readline() == b"ready\n"  # in the fourth epoch
    finally:
        process.kill()
        process.communicate()
    assert killed.checkpoint.is_file()
    assert not killed.model.is_file()
    assert len(killed.metric_lines()) == 3
    samples = read_dataset(data)
    train(config, samples, killed.folder, device="cpu")
    train(config, samples, whole.folder, device="cpu")
    assert_same_run(killed, whole)


def test_finished_run_is_left_alone(
    tmp_path: Path, dataset: Dataset, make_config: MakeConfig
) -> None:
    run = RunFolder(tmp_path / "run")
    train(make_config(epochs=1), dataset, run.folder, device="cpu")
    before = {path: path.stat().st_mtime_ns for path in run.folder.rglob("*")}
    train(make_config(epochs=1), dataset, run.folder, device="cpu")
    assert {path: path.stat().st_mtime_ns for path in run.folder.rglob("*")} == before


def test_lost_measures_of_epochs_after_the_checkpoint_are_made_again(
    tmp_path: Path, dataset: Dataset, make_config: MakeConfig
) -> None:
    run, whole = RunFolder(tmp_path / "run"), RunFolder(tmp_path / "whole")
    config = make_config(epochs=4)
    train(config, dataset, run.folder, device="cpu", stop_after=2)
    append_line(run.metrics, {"epoch": 3, "train_loss": 0.0, "seconds": 0.0})
    train(config, dataset, run.folder, device="cpu")
    train(config, dataset, whole.folder, device="cpu")
    assert_same_run(run, whole)


def test_diverged_training_fails(
    tmp_path: Path, dataset: Dataset, make_config: MakeConfig, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A learning rate of 1e30, which a configuration may not have."""
    run = RunFolder(tmp_path / "run")
    monkeypatch.setattr(ScheduleConfig, "factor", lambda *_: 1e30)
    with pytest.raises(
        WorkError, match=r"diverged in epoch 1, with a loss of (nan|inf); no checkpoint is kept"
    ):
        train(make_config("adam", learning_rate=1.0), dataset, run.folder, device="cpu")
    assert not run.model.exists()
    assert not run.checkpoint.exists()


def test_training_whose_errors_grow_without_bound_fails(
    tmp_path: Path, dataset: Dataset, make_config: MakeConfig
) -> None:
    """With the largest learning rate of a configuration, losses stay finite numbers."""
    run = RunFolder(tmp_path / "run")
    config = make_config("adam", learning_rate=10.0, epochs=20)
    with pytest.raises(WorkError, match=r"diverged in epoch \d+, with an error of .* m on valid"):
        train(config, dataset, run.folder, device="cpu")
    assert not run.model.exists()


def test_loss_that_is_not_finite_keeps_the_last_checkpoint(
    tmp_path: Path, dataset: Dataset, make_config: MakeConfig, monkeypatch: pytest.MonkeyPatch
) -> None:
    run, config = RunFolder(tmp_path / "run"), make_config()
    train(config, dataset, run.folder, device="cpu", stop_after=2)
    before = run.checkpoint.read_bytes()
    loss = TrainedModel.data_loss
    monkeypatch.setattr(
        TrainedModel, "data_loss", lambda self, *fields: loss(self, *fields) * torch.nan
    )
    with pytest.raises(
        WorkError, match="diverged in epoch 3, with a loss of nan; the checkpoint of epoch 2"
    ):
        train(config, dataset, run.folder, device="cpu")
    assert run.checkpoint.read_bytes() == before
    assert not run.model.exists()
    assert [line["epoch"] for line in run.metric_lines()] == [1, 2]


def test_weights_that_are_not_finite_are_never_a_model(
    tmp_path: Path, dataset: Dataset, make_config: MakeConfig, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The only step makes the weights infinite; the loss before the step is finite."""
    run = RunFolder(tmp_path / "run")
    monkeypatch.setattr(ScheduleConfig, "factor", lambda *_: 1e39)
    config = make_config("adam", learning_rate=1.0, epochs=1, batch_size=64)
    with pytest.raises(WorkError):
        train(config, dataset, run.folder, device="cpu")
    assert not run.model.exists()


@pytest.mark.parametrize(
    ("update", "difference"),
    [
        ({"seed": 1}, "run.seed = 1, the folder has 0"),
        ({"name": "other"}, "run.name = 'other', the folder has 'small'"),
    ],
)
def test_run_of_another_configuration_is_refused(
    tmp_path: Path,
    dataset: Dataset,
    make_config: MakeConfig,
    update: dict[str, Any],
    difference: str,
) -> None:
    run, config = RunFolder(tmp_path / "run"), make_config()
    train(config, dataset, run.folder, device="cpu", stop_after=1)
    before = run.checkpoint.read_bytes()
    with pytest.raises(InputError, match="a run with another ") as error:
        train(config.model_copy(update=update), dataset, run.folder, device="cpu")
    assert difference in str(error.value)
    assert run.checkpoint.read_bytes() == before


def test_run_of_another_dataset_is_refused(
    tmp_path: Path, dataset: Dataset, make_config: MakeConfig, make_dataset: Callable[..., Path]
) -> None:
    run = RunFolder(tmp_path / "run")
    train(make_config(), dataset, run.folder, device="cpu", stop_after=1)
    other = read_dataset(make_dataset(tmp_path / "other", seed=1))
    with pytest.raises(InputError, match=r"a run with another data\.digest = "):
        train(make_config(), other, run.folder, device="cpu")


def test_wrong_case_is_refused(
    tmp_path: Path, dataset_3d: Dataset, make_config: MakeConfig
) -> None:
    run = RunFolder(tmp_path / "run")
    with pytest.raises(InputError, match="'case' = 'beam2d', the dataset is of case 'block3d'"):
        train(make_config(), dataset_3d, run.folder, device="cpu")
    assert not run.folder.exists()


@pytest.mark.parametrize("recipe", RECIPES)
def test_loss_falls(
    tmp_path: Path, dataset: Dataset, make_config: MakeConfig, recipe: dict[str, Any]
) -> None:
    """Scaled by the root mean square, the loss starts near 1, the value of zero displacement."""
    run = RunFolder(tmp_path / "run")
    train(make_config(epochs=40, learning_rate=2e-2, **recipe), dataset, run.folder, device="cpu")
    lines = run.metric_lines()
    assert lines[-1]["train_loss"] < 0.25 * lines[0]["train_loss"]
    assert lines[-1]["validation_loss"] < 0.5 * lines[0]["validation_loss"]


def test_gradient_clip_bounds_the_gradient(
    dataset: Dataset, make_config: MakeConfig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    norms: list[float] = []
    clip = torch.nn.utils.clip_grad_norm_

    def record(parameters: Any, limit: float) -> Tensor:
        parameters = list(parameters)
        clip(parameters, limit)
        norms.append(sum(p.grad.square().sum().item() for p in parameters) ** 0.5)
        return torch.tensor(0.0)

    monkeypatch.setattr(torch.nn.utils, "clip_grad_norm_", record)
    config = make_config(epochs=1, gradient_clip=1e-3)
    train(config, dataset, tmp_path / "run", device="cpu")
    assert len(norms) == 3  # 43 training samples in batches of 16
    assert max(norms) <= 1e-3 * (1 + 1e-5)


def test_progress_says_loss_and_validation_error(
    tmp_path: Path, dataset: Dataset, make_config: MakeConfig, capsys: pytest.CaptureFixture[str]
) -> None:
    """The last line of measures, and its error over the largest displacement of each sample."""
    run = RunFolder(tmp_path / "run")
    with shown_progress():
        train(make_config(), dataset, run.folder, device="cpu")
    last = run.metric_lines()[-1]
    said = capsys.readouterr().err
    assert f"epoch 6, loss {last['train_loss']:.3g}, validation error" in said
    rows = split_training(dataset.train, make_config()).validation_rows
    held_out = dataset.nodal_train(rows)
    predicted = load(run.folder).predict(held_out.force)
    measured = measure(held_out.force, predicted, held_out.displacement, dataset.geometry.tip)
    relative = measured.relative_error_mean  # as `surrogate evaluate` has it
    assert last["validation_relative_error"] == pytest.approx(relative, rel=1e-4)
    assert f"{last['validation_error']:.2e} m ({relative:.2%} of the largest disp" in said


def test_advice_when_samples_are_too_few(
    tmp_path: Path, dataset: Dataset, make_config: MakeConfig, capsys: pytest.CaptureFixture[str]
) -> None:
    """Four samples are learnt by heart; of validation samples the network then knows little."""
    config = make_config(epochs=400, samples=5, validation_fraction=0.2)
    with logged("surrogate"):
        train(config, dataset, tmp_path / "few", device="cpu")
    advised = [line for line in capsys.readouterr().err.splitlines() if "advice" in line]
    assert len(advised) == 1
    assert "more than 4 training samples would help" in advised[0]


def test_no_convolutions_along_a_row_of_nodes(
    tmp_path: Path, dataset: Dataset, make_config: MakeConfig
) -> None:
    """On `structure --grid nodes`, neighbours on the grid are none in space."""
    geometry = dataset.geometry
    row = replace(geometry, grid=Grid.in_a_row(*geometry.coordinates.shape))
    with pytest.raises(InputError, match="a U-Net, on a dataset whose nodes stand in a row"):
        train(make_config(), replace(dataset, geometry=row), tmp_path / "run", device="cpu")
    assert not (tmp_path / "run").exists()


def test_network_too_deep_for_its_grid(
    tmp_path: Path, dataset: Dataset, make_config: MakeConfig
) -> None:
    """8 x 4 points and a row of zeros around: 6 rows can be halved twice."""
    config = make_config()
    deeper = config.model_copy(update={"network": config.network.model_copy(update={"levels": 4})})
    with pytest.raises(
        InputError, match=r"'network.levels' = 4: expected 3 at most, .* 8 x 4 grid"
    ):
        train(deeper, dataset, tmp_path / "run", device="cpu")
    assert not (tmp_path / "run").exists()


def test_streams_of_one_seed_differ() -> None:
    """Every purpose has its own stream: weights, validation split, order, noise, passes."""
    counted = [(7, kind, number) for kind in (2, 3, 4) for number in range(100)]
    used = [(7, 0), (7, 1), *counted, (8, 0), (8, 1), (8, 2, 0), (8, 3, 0), (8, 4, 0)]
    assert len({stream(*numbers) for numbers in used}) == len(used)
    assert stream(7, 2, 5) == stream(7, 2, 5)


def test_device(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    assert choose_device("auto") == choose_device("cpu") == CPU
    with pytest.raises(InputError, match="'cuda': none here"):
        choose_device("cuda")


def test_a_training_on_two_samples_warns(
    dataset: Dataset, make_config: MakeConfig, caplog: pytest.LogCaptureFixture
) -> None:
    few = replace(dataset, train_in_memory=dataset.train[:2])
    split_for(make_config(epochs=1), few)
    assert [r.getMessage().split(",")[0] for r in caplog.records] == ["2 training samples"]
