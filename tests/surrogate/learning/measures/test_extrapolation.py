from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from shared_schema.common.errors import InputError
from shared_schema.manifest import read_manifest, write_manifest
from surrogate.learning.data.joined_dataset import read_dataset
from surrogate.learning.data.samples import read_nodal_dataset
from surrogate.learning.evaluation.run_evaluation import Evaluation, evaluate


def test_nodal_samples_are_those_of_the_grid(data: Path) -> None:
    nodal, structured = read_nodal_dataset(data.parent / "nodal"), read_dataset(data)
    assert len(nodal.samples.force) == len(structured.train) + len(structured.test)
    found = {force.astype(np.float32).tobytes() for force in nodal.samples.force}
    assert all(f.astype(np.float32).tobytes() in found for f in structured.nodal_test.force)


@pytest.fixture(scope="module")
def run(make_run: Callable[..., Path]) -> Path:
    """A network of variational Bayes, shortly trained."""
    return make_run(likelihood="variational_bayes", epochs=15)


@pytest.fixture(scope="module")
def evaluation(run: Path, data: Path) -> Evaluation:
    return evaluate(run, data, passes=7, seed=3, loads=data.parent / "nodal")


@pytest.fixture(scope="module")
def content(evaluation: Evaluation) -> dict[str, Any]:
    return evaluation.content


def test_uncertainty_of_the_test_split(evaluation: Evaluation, content: dict[str, Any]) -> None:
    """Coverage by its definition: |u - μ| within 1.959964 σ, over components of free nodes."""
    assert evaluation.calibration is not None
    assert (content["uncertainty"]["passes"], content["uncertainty"]["passes_seed"]) == (7, 3)
    free = ~evaluation.surrogate.geometry.clamped
    again = evaluation.surrogate.predict_distribution(evaluation.force, 7, 3)
    error = np.abs(again.mean - evaluation.reference)[:, free]
    expected = (error <= 1.959964 * again.std[:, free]).mean()
    assert content["uncertainty"]["intervals"][2]["level"] == 0.95
    assert content["uncertainty"]["intervals"][2]["coverage"] == pytest.approx(expected)


def test_measures_under_other_loads(evaluation: Evaluation, content: dict[str, Any]) -> None:
    extrapolation, found = evaluation.extrapolation, content["extrapolation"]
    assert extrapolation is not None
    force = extrapolation.samples.force
    assert found["case"] == "beam2d"
    limit = max(evaluation.surrogate.description.data.info.force.max_abs)
    np.testing.assert_allclose(found["reach"], np.abs(force).max(axis=(1, 2)) / limit)
    error = np.abs(extrapolation.predicted.mean - extrapolation.samples.displacement)
    np.testing.assert_allclose(found["mean_error"], error.mean(axis=(1, 2)))
    std = extrapolation.predicted.std[:, 4:]  # all but the four clamped nodes
    np.testing.assert_allclose(found["mean_std"], std.mean(axis=(1, 2)))
    np.testing.assert_allclose(
        found["inside_95"], (error[:, 4:] <= 1.959964 * std).mean(axis=(1, 2)), atol=1e-3
    )


@pytest.mark.parametrize("key", ["mesh", "supports", "material"])
def test_another_body_is_refused(tmp_path: Path, data: Path, run: Path, key: str) -> None:
    folder = tmp_path / "nodal"
    shutil.copytree(data.parent / "nodal", folder)
    manifest = read_manifest(folder, "nodal")
    changed = manifest.model_copy(update={"case": {**manifest.case, key: "other"}})
    write_manifest(folder, changed)
    before = (run / "evaluation.json").read_bytes() if (run / "evaluation.json").exists() else b""
    with pytest.raises(InputError, match=f"another body than the run's: {key} = 'other'"):
        evaluate(run, data, loads=folder)
    after = (run / "evaluation.json").read_bytes() if (run / "evaluation.json").exists() else b""
    assert after == before
