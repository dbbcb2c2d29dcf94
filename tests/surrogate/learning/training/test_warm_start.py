from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch
import yaml

import surrogate
from shared_schema.common.command_line import logged
from shared_schema.common.errors import InputError
from surrogate.command_line import main
from surrogate.learning.data.dataset import Dataset
from surrogate.learning.data.joined_dataset import read_dataset
from surrogate.learning.models.kinds import run_config
from surrogate.learning.models.unet_model import UNetModel
from surrogate.learning.runs.folder import RunFolder
from surrogate.learning.training.loop import train
from tests.surrogate.resuming import untimed

CPU = torch.device("cpu")
MakeConfig = Callable[..., UNetModel]


@pytest.fixture(scope="module")
def other(tmp_path_factory: pytest.TempPathFactory, make_dataset: Callable[..., Path]) -> Dataset:
    """Another dataset of the same body, with larger forces: other scales."""
    forces = np.random.default_rng(5).uniform(-6, 6, (60, 2))
    return read_dataset(make_dataset(tmp_path_factory.mktemp("other"), corner_forces=forces))


def test_the_network_begins_as_that_of_the_other_run(
    trained: Path, other: Dataset, dataset: Dataset, tmp_path: Path, make_config: MakeConfig
) -> None:
    """With a learning rate that changes no weight, the predictions are the same."""
    config = make_config("adam", epochs=1, learning_rate=1e-30)
    run = RunFolder(tmp_path / "run")
    train(config, other, run.folder, device="cpu", start_from=trained)
    force = dataset.nodal_test.force
    expected = surrogate.load(trained).predict(force)
    assert np.array_equal(surrogate.load(run.folder).predict(force), expected)
    assert not np.array_equal(expected, 0 * expected)


def test_it_is_recorded_and_resumed(
    trained: Path,
    other: Dataset,
    tmp_path: Path,
    make_config: MakeConfig,
    capsys: pytest.CaptureFixture[str],
) -> None:
    config = make_config(epochs=4)
    whole, parts = RunFolder(tmp_path / "whole"), RunFolder(tmp_path / "parts")
    train(config, other, whole.folder, device="cpu", start_from=trained)
    capsys.readouterr()
    with logged("surrogate"):
        train(config, other, parts.folder, device="cpu", stop_after=2, start_from=trained)
    said = "starting from the weights of 'small'; the learning rate begins its schedule anew"
    assert f"{said}, with a peak of 0.005" in capsys.readouterr().err
    with pytest.raises(InputError, match=r"another start_from = None, the folder has"):
        train(config, other, parts.folder, device="cpu")
    capsys.readouterr()
    with logged("surrogate"):
        train(config, other, parts.folder, device="cpu", start_from=trained)
    assert "begins its schedule anew" not in capsys.readouterr().err
    assert whole.model.read_bytes() == parts.model.read_bytes()
    origin = whole.description().start_from
    assert origin is not None
    assert origin.run == "small"
    assert origin.data == RunFolder(trained).description().data.digest


def test_more_samples_are_learnt_sooner(
    trained: Path, make_dataset: Callable[..., Path], tmp_path: Path, make_config: MakeConfig
) -> None:
    """Other samples of the same kind: the loss of the first epoch."""
    warm, cold = RunFolder(tmp_path / "warm"), RunFolder(tmp_path / "cold")
    more = read_dataset(make_dataset(tmp_path, seed=1))
    train(make_config(epochs=1), more, warm.folder, device="cpu", start_from=trained)
    train(make_config(epochs=1), more, cold.folder, device="cpu")
    assert "start_from" not in yaml.safe_load(cold.config.read_text())
    assert cold.description().start_from is None
    first = [untimed(run)[0]["train_loss"] for run in (warm, cold)]
    assert first[0] < 0.7 * first[1]


def test_factors_of_a_recalibration_are_dropped(
    make_run: Callable[..., Path], dataset: Dataset, tmp_path: Path, make_config: MakeConfig
) -> None:
    options = {"likelihood": "maximum_likelihood", "epochs": 2}
    before = make_run(recalibrate=True, **options)
    assert float(surrogate.load(before).network.aleatoric_factor) != 1
    train(make_config(**options), dataset, tmp_path / "run", device="cpu", start_from=before)
    assert float(surrogate.load(tmp_path / "run").network.aleatoric_factor) == 1


def test_refusals(
    trained: Path,
    dataset: Dataset,
    dataset_3d: Dataset,
    tmp_path: Path,
    make_config: MakeConfig,
    make_dataset: Callable[..., Path],
) -> None:
    config, run = make_config(), RunFolder(tmp_path / "run")
    wider = config.model_copy(
        update={"network": config.network.model_copy(update={"channels": 9, "padding": 2})}
    )
    softer = read_dataset(make_dataset(tmp_path / "soft", material={"young_modulus": 7.0}))
    pod = run_config(
        {"name": "p", "case": "beam2d", "model": "pod", "pod": {"regression": "ridge"}}
    )
    in_3d = make_config(dimension=3)
    for part, model, data, origin in (
        (
            "'small' has another network.channels = 9, that run has 8",
            wider,
            dataset,
            trained,
        ),
        ("material = {'young_modulus': 7.0}, expected", config, softer, trained),
        ("mesh = ", in_3d, dataset_3d, trained),
        ("config 'p' is fitted directly, expected a network", pod, dataset, trained),
        ("no run there", config, dataset, tmp_path / "nowhere"),
    ):
        with pytest.raises(InputError) as error:
            train(model, data, run.folder, device="cpu", start_from=origin)
        assert part in str(error.value)
        assert not run.folder.exists()


def test_command(
    trained: Path,
    data: Path,
    tmp_path: Path,
    make_config: MakeConfig,
    capsys: pytest.CaptureFixture[str],
) -> None:
    path, run = tmp_path / "a.yaml", RunFolder(tmp_path / "run")
    path.write_text(yaml.safe_dump(make_config(epochs=1).plain()))
    command = ["train", str(path), "--data", str(data), "--out", str(run.folder)]
    assert main([*command, "--start-from", str(trained)]) == 0
    assert run.description().start_from is not None
    assert main([*command, "--start-from", str(tmp_path)]) == 2
    assert f"{tmp_path}: no run there" in capsys.readouterr().err
