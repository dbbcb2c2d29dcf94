"""Trainings on embedded grids measure errors at the nodes, and know the part of the grid."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import torch

from shared_schema.common.units import Units
from surrogate.learning.data.joined_dataset import read_dataset
from surrogate.learning.inference.loading import load
from surrogate.learning.measures.error_metrics import measure, sample_errors
from surrogate.learning.models.kinds import run_config
from surrogate.learning.models.unet_model import UNetModel
from surrogate.learning.optim.final_weights import EarlyStopping
from surrogate.learning.runs.folder import RunFolder
from surrogate.learning.runs.split import split_training
from surrogate.learning.training.loop import train
from surrogate.learning.training.training_log import advice, epoch_note
from tests.surrogate.embedded_box import on_points
from tests.surrogate.learning.data.test_embedded_dataset import embedded

MakeConfig = Callable[..., UNetModel]
ON_A_GPU = [
    pytest.mark.gpu,
    pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device"),
]
REDUCED = {"input_modes": 8, "output_modes": 10, "width": 32}


@pytest.fixture(scope="module")
def coarse(data_3d: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """8 × 4 × 4 nodes on a grid of 4 × 3 × 3 points, as of a bar in a grid that is too coarse."""
    return embedded(data_3d, tmp_path_factory.mktemp("box") / "data", on_points(4, 3, 3))


def of_kind(kind: str, make_config: MakeConfig) -> Any:
    config = make_config(epochs=3, dimension=3)
    if kind == "plain":
        return config
    training = config.plain()["training"]
    content = {"name": kind, "case": config.case, "training": training}
    if kind == "reduced":
        return run_config({**content, "model": "reduced", "network": REDUCED})
    network = {"levels": 2, "channels": 4, "inputs": ["force", "linear_gradient"]}
    return run_config({**content, "network": {**network, "skip": "linear"}})


@pytest.mark.parametrize("device", ["cpu", pytest.param("cuda", marks=ON_A_GPU)])
@pytest.mark.parametrize("kind", ["plain", "linear response", "reduced"])
def test_validation_errors_are_those_at_the_nodes(
    coarse: Path, tmp_path: Path, make_config: MakeConfig, kind: str, device: str
) -> None:
    """What the last epoch says is ē of the nodal solutions, as `surrogate evaluate` measures it."""
    config, dataset = of_kind(kind, make_config), read_dataset(coarse)
    train(config, dataset, tmp_path / "run", device=device)
    last = RunFolder(tmp_path / "run").metric_lines()[-1]
    held_out = dataset.nodal_train(split_training(dataset.train, config).validation_rows)
    predicted = load(tmp_path / "run").predict(held_out.force)
    tip = dataset.geometry.tip
    expected = measure(held_out.force, predicted, held_out.displacement, tip)
    assert last["validation_error"] == pytest.approx(expected.mean_error, rel=1e-4)
    assert last["validation_relative_error"] == pytest.approx(
        expected.relative_error_mean, rel=1e-4
    )
    assert last["grid_error"] > 0


def test_the_part_of_the_grid(coarse: Path, tmp_path: Path, make_config: MakeConfig) -> None:
    """That of a network without a response: solutions to the grid and back, 0 at the supports."""
    config, dataset = of_kind("plain", make_config), read_dataset(coarse)
    train(config, dataset, tmp_path / "run", device="cpu")
    last = RunFolder(tmp_path / "run").metric_lines()[-1]
    held_out = dataset.nodal_train(split_training(dataset.train, config).validation_rows)
    grid, u = dataset.geometry.grid, held_out.displacement
    expected = sample_errors(grid.to_nodes(grid.to_grid(u)), u).mean()  # supports are on a side
    assert last["grid_error"] == pytest.approx(expected, rel=1e-4)


def test_advice_is_a_finer_grid_where_its_part_is_large() -> None:
    """6 of 10 mm are the grid's part; of 4 of 10 mm it is the samples that are too few."""
    network = SimpleNamespace(displacement_rms=1.0)
    trainer = SimpleNamespace(training_error=lambda: 1e-3, train=range(40), network=network)
    measures = {"validation_error": 1e-2, "grid_error": 6e-3}
    assert "a finer grid would help" in str(advice(trainer, measures))  # type: ignore[arg-type]
    measures["grid_error"] = 4e-3
    said = str(advice(trainer, measures))  # type: ignore[arg-type]
    assert "more than 40 training samples would help" in said
    in_mm = str(advice(trainer, measures, Units(length="mm")))  # type: ignore[arg-type]
    assert "validation samples is 1.00e-02 mm, on training samples 1.00e-03 mm" in in_mm
    note = epoch_note(1, {**measures, "train_loss": 0.5, "validation_relative_error": 0.2})
    assert note.endswith("validation error 1.00e-02 m (20.00% of the largest displacement)")


def test_the_best_epoch_is_that_of_the_nodes(
    coarse: Path, tmp_path: Path, make_config: MakeConfig, monkeypatch: pytest.MonkeyPatch
) -> None:
    observed: list[float] = []
    keep = EarlyStopping.observe

    def observe(self: EarlyStopping, epoch: int, loss: float, network: Any) -> None:
        observed.append(loss)
        keep(self, epoch, loss, network)

    monkeypatch.setattr(EarlyStopping, "observe", observe)
    config = make_config(epochs=3, dimension=3, early_stopping={"patience": 5})
    train(config, read_dataset(coarse), tmp_path / "run", device="cpu")
    lines = RunFolder(tmp_path / "run").metric_lines()
    assert observed == [line["validation_error"] for line in lines]
