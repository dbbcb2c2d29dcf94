from __future__ import annotations

import json
import logging
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import surrogate
from shared_schema.common.errors import InputError
from surrogate.learning.data.dataset import Dataset
from surrogate.learning.evaluation.run_evaluation import evaluate
from surrogate.learning.inference.surrogate import Surrogate
from surrogate.learning.measures.error_metrics import Array, ErrorMeasures, measure
from surrogate.learning.networks.field_network import parameter_count


@pytest.fixture(scope="module")
def content(evaluated: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((evaluated / "evaluation.json").read_text())
    return found


@dataclass(frozen=True)
class Again:
    """What an evaluation consists of."""

    surrogate: Surrogate
    force: Array
    reference: Array
    predicted: Array
    measures: ErrorMeasures


@pytest.fixture(scope="module")
def again(evaluated: Path, dataset: Dataset) -> Again:
    """The same evaluation, made here from predictions alone."""
    model = surrogate.load(evaluated)
    grid = model.geometry.grid
    force = grid.to_nodes(dataset.test.force.double().numpy())
    reference = grid.to_nodes(dataset.test.displacement.double().numpy())
    predicted = model.averaged_passes(force).mean
    tip = 31  # the upper right corner, the farthest that may be loaded
    measures = measure(force, predicted, reference, tip)
    return Again(model, force, reference, predicted, measures)


def test_measures(content: dict[str, Any], again: Again) -> None:
    assert content["test"]["samples"] == 12
    errors = np.abs(again.predicted - again.reference)
    assert content["test"]["mean_error"] == pytest.approx(errors.mean())
    deviation = errors.reshape(12, -1).mean(axis=1).std(ddof=1)
    assert content["test"]["std_error"] == pytest.approx(deviation)
    assert content["test"]["max_error"] == pytest.approx(errors.max())
    assert content["test"] == pytest.approx(again.measures.plain())
    assert 0 < content["test"]["mean_error"] < np.abs(again.reference).mean()


def test_run_and_dataset_are_recorded(
    content: dict[str, Any], again: Again, dataset: Dataset, evaluated: Path
) -> None:
    assert (content["run"], content["case"], content["seed"]) == ("small", "beam2d", 0)
    assert content["data_digest"] == dataset.manifest.digest
    assert content["trained_on_this_data"] is True
    assert content["trainable_parameters"] == parameter_count(again.surrogate.network)
    assert content["epochs"] == 40
    last = json.loads((evaluated / "metrics.jsonl").read_text().splitlines()[-1])
    assert content["training_seconds"] == last["seconds"]


def test_example_is_loaded_at_the_tip(
    content: dict[str, Any], again: Again, evaluated: Path, dataset: Dataset
) -> None:
    """The sample loaded at node 31 that moves closest to 3/4 of the most, or as far as wanted."""
    moved = np.linalg.norm(again.reference[:, 31], axis=1)
    at_tip = [m for m in range(12) if again.force[m, 31].any()]
    assert at_tip, "the synthetic test split has no such sample"
    wanted = evaluate(evaluated, dataset, example_displacement=0.95)
    assert wanted.example == min(at_tip, key=lambda m: abs(moved[m] - 0.95))
    aim = 0.75 * max(moved[at_tip])
    best = min(at_tip, key=lambda m: abs(moved[m] - aim))
    assert evaluate(evaluated, dataset).example == best
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


def test_text_and_figures(evaluated: Path, dataset: Dataset, content: dict[str, Any]) -> None:
    """Its text says the mean error; a figure is drawn by its name."""
    found = evaluate(evaluated, dataset)
    assert f"mean error {content['test']['mean_error']:.3e} m" in repr(found)
    assert found.plot("errors").axes[0].get_ylabel().startswith("mean error")
    with pytest.raises(InputError, match="figure 'sweep': expected one of deformed, "):
        found.plot("sweep")


def test_a_network_of_the_package_is_not_written_into(
    evaluated: Path, dataset: Dataset, tmp_path: Path
) -> None:
    copy = evaluate(evaluated, dataset).write(tmp_path / "copy")
    assert (copy / "evaluation.json").read_bytes() == (evaluated / "evaluation.json").read_bytes()
    with pytest.raises(InputError, match="exists, expected a new folder"):
        evaluate(evaluated, dataset).write(copy)


def test_evaluation_goes_on_without_a_fast_certificate(
    evaluated: Path,
    dataset: Dataset,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    """Of a body that has none; what can be evaluated is."""

    def refuse(*body: object) -> None:
        raise InputError("bounds are for other bodies")

    monkeypatch.setattr("surrogate.mechanics.certify.fast_estimate.FastEstimate", refuse)
    with caplog.at_level(logging.WARNING, logger="surrogate"):
        found = evaluate(evaluated, dataset, certify=True)
    assert found.fast_certificate is None
    assert found.content["test"]["samples"] == 12
    assert "no fast certificate: bounds are for other bodies" in caplog.text
