from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import surrogate
from shared_schema.common.errors import InputError
from surrogate.data.dataset import Dataset
from surrogate.evaluation.error_metrics import measure
from surrogate.evaluation.evaluate import Evaluation, evaluate
from surrogate.networks.unet import parameter_count


@pytest.fixture(scope="module")
def content(evaluated: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((evaluated / "evaluation.json").read_text())
    return found


@pytest.fixture(scope="module")
def again(evaluated: Path, dataset: Dataset) -> Evaluation:
    """The same evaluation, made here from predictions alone."""
    model = surrogate.load(evaluated)
    grid = model.geometry.grid
    force = grid.to_nodes(dataset.test.force.double().numpy())
    reference = grid.to_nodes(dataset.test.displacement.double().numpy())
    predicted = model.predict_distribution(force)
    tip = 31  # the upper right corner, the farthest that may be loaded
    measures = measure(force, predicted.mean, reference, tip)
    return Evaluation(model, force, reference, predicted, measures, None, None)


def test_measures(content: dict[str, Any], again: Evaluation) -> None:
    assert content["test"]["samples"] == 12
    errors = np.abs(again.predicted - again.reference)
    assert content["test"]["mean_error"] == pytest.approx(errors.mean())
    deviation = errors.reshape(12, -1).mean(axis=1).std(ddof=1)
    assert content["test"]["std_error"] == pytest.approx(deviation)
    assert content["test"]["max_error"] == pytest.approx(errors.max())
    assert content["test"] == pytest.approx(again.measures.plain())
    assert 0 < content["test"]["mean_error"] < np.abs(again.reference).mean()


def test_run_and_dataset_are_recorded(
    content: dict[str, Any], again: Evaluation, dataset: Dataset, evaluated: Path
) -> None:
    assert (content["run"], content["case"], content["seed"]) == ("small", "beam2d", 0)
    assert content["data_digest"] == dataset.manifest.digest
    assert content["trained_on_this_data"] is True
    assert content["trainable_parameters"] == parameter_count(again.surrogate.network)
    assert content["epochs"] == 40
    last = json.loads((evaluated / "metrics.jsonl").read_text().splitlines()[-1])
    assert content["training_seconds"] == last["seconds"]


def test_example_is_loaded_at_the_tip(content: dict[str, Any], again: Evaluation) -> None:
    """The sample loaded at node 31 that moves closest to 3/4 of the most, or as far as wanted."""
    moved = np.linalg.norm(again.reference[:, 31], axis=1)
    at_tip = [m for m in range(12) if again.force[m, 31].any()]
    assert at_tip, "the synthetic test split has no such sample"
    wanted = replace(again, example_displacement=0.95)
    assert wanted.example == min(at_tip, key=lambda m: abs(moved[m] - 0.95))
    aim = 0.75 * max(moved[at_tip])
    best = min(at_tip, key=lambda m: abs(moved[m] - aim))
    assert again.example == best
    error = np.linalg.norm(again.predicted[best, 31] - again.reference[best, 31])
    assert content["example"]["tip_displacement"] == pytest.approx(moved[best])
    assert content["example"]["relative_tip_error"] == pytest.approx(error / moved[best])


def test_other_data_of_the_same_case(
    trained: Path, tmp_path: Path, make_dataset: Callable[..., Path]
) -> None:
    run = tmp_path / "run"
    shutil.copytree(trained, run)
    found = evaluate(run, make_dataset(tmp_path, seed=1))
    assert found.content["trained_on_this_data"] is False


@pytest.mark.parametrize(
    ("change", "part"),
    [
        ({"name": "plate2d"}, "trained on case 'beam2d', the dataset is of case 'plate2d': name"),
        ({"material": {"young_modulus": 7.0}}, "material = {'young_modulus': 7.0}"),
        ({"supports": [{"y": 0}]}, "supports = "),
    ],
)
def test_other_case_is_refused(
    trained: Path,
    tmp_path: Path,
    make_dataset: Callable[..., Path],
    change: dict[str, Any],
    part: str,
) -> None:
    with pytest.raises(InputError) as error:
        evaluate(trained, make_dataset(tmp_path, **change))
    assert part in str(error.value)
    assert not (trained / "evaluation.json").exists()


def test_other_dimension_is_refused(trained: Path, data_3d: Path) -> None:
    with pytest.raises(InputError, match="the dataset is of case 'block3d'"):
        evaluate(trained, data_3d)


def test_other_loads_are_accepted(
    trained: Path, tmp_path: Path, make_dataset: Callable[..., Path]
) -> None:
    run = tmp_path / "run"
    shutil.copytree(trained, run)
    found = evaluate(run, make_dataset(tmp_path, load={"family": "other"}))
    assert found.measures.samples == 12
