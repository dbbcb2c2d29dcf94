"""The load series as a model: no sample makes it, and every command takes it."""

from __future__ import annotations

import json
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import surrogate
from shared_schema.common.errors import InputError
from shared_schema.manifest import digest_of, read_manifest, write_manifest
from shared_schema.shard import read_attributes, read_shard, write_shard
from surrogate.command_line import main
from surrogate.learning.data.case_loads import random_loads
from surrogate.learning.data.joined_dataset import read_dataset
from surrogate.mechanics.equilibrium.out_of_balance import Equilibrium

SHARD = "shard-00000.h5"


def body_of(data: Path, folder: Path, material: dict[str, Any] | None = None) -> Path:
    """Write a dataset without its samples, as `datagen body` does; of another material if given."""
    folder.mkdir()
    arrays = read_shard(data / SHARD, "structured")
    rows = {name: values[:0] for name, values in arrays.items() if name.startswith("samples/")}
    manifest = read_manifest(data)
    case = {**manifest.case, "material": material or manifest.case["material"]}
    cell_type = str(read_attributes(data / SHARD, "structured")["cell_type"])
    digest = write_shard(folder / SHARD, "structured", arrays | rows, digest_of(case), cell_type)
    entry = manifest.shards[0].model_copy(update={"samples": 0, "sha256": digest})
    assert manifest.structured is not None
    changes = {
        "case": case,
        "case_digest": digest_of(case),
        "samples": 0,
        "shards": (entry,),
        "structured": manifest.structured.model_copy(update={"train": 0, "test": 0}),
    }
    write_manifest(folder, manifest.model_copy(update=changes))
    return folder


@pytest.fixture(scope="module")
def body(data: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return body_of(data, tmp_path_factory.mktemp("series") / "body")


@pytest.fixture(scope="module")
def run(body: Path) -> Path:
    surrogate.train("series", body, body.parent / "run")
    return body.parent / "run"


def forces_of(model: surrogate.Surrogate, size: float) -> np.ndarray:
    """A force across the body at the tip, alone and with a smaller one along it."""
    forces = np.zeros((2, *model.geometry.coordinates.shape))
    forces[:, model.geometry.tip, 1] = -size
    forces[1, model.geometry.tip, 0] = 0.3 * size
    return forces


def test_errors_are_of_sixth_order(run: Path) -> None:
    """Half the load leaves about 2⁻⁶ of the error of a series to order 5."""
    model = surrogate.load(run)
    errors = []
    for size in (2.0, 1.0):
        forces = forces_of(model, size)
        exact = np.stack([found.displacement for found in model.correct_each(forces)])
        with warnings.catch_warnings():
            warnings.simplefilter("error")  # no force is outside of a training
            errors.append(np.abs(model.predict(forces) - exact).max())
            one = model.predict(forces[0])
        assert np.allclose(one, exact[0], rtol=0, atol=errors[-1])
    assert 2**-8 < errors[1] / errors[0] < 2**-5


def test_other_materials_have_their_series(data: Path, tmp_path: Path) -> None:
    """Five terms are the equilibrium, whose linear response is off by 0.7 %."""
    yeoh = {"model": "yeoh", "c10": 80.0, "c20": 4.0, "c30": 0.1, "bulk_modulus": 800.0}
    model = surrogate.train("series", body_of(data, tmp_path / "body", yeoh), tmp_path / "run")
    forces = forces_of(model, 0.5)
    found = model.predict(forces)
    expected = np.array([each.displacement for each in model.correct_each(forces, found)])
    linear = Equilibrium(model.geometry, model.description.data.material).linear_response(forces)
    largest = np.abs(expected).max()
    assert np.abs(found - expected).max() < 1e-4 * largest
    assert np.abs(linear - expected).max() > 5e-3 * largest
    np.testing.assert_array_equal(model.solve(forces[0]).displacement, model.predict(forces[0]))
    by_passes = model.averaged_passes(forces).mean  # in single precision
    np.testing.assert_allclose(by_passes, found, rtol=0, atol=1e-6 * largest)


def test_run_is_evaluated_on_samples_of_its_body(run: Path, data: Path, tmp_path: Path) -> None:
    evaluation = surrogate.evaluate(run, data)
    assert evaluation.content["trainable_parameters"] == 0
    assert evaluation.content["trained_on_this_data"]  # as on any: it was trained on no other
    folder = evaluation.write(tmp_path / "evaluated")
    assert json.loads((folder / "evaluation.json").read_text())["run"] == "beam2d-series"
    assert repr(surrogate.load(run)) == "Surrogate(beam2d, 32 nodes, load series)"


def test_fast_bounds_without_a_dataset(
    body: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Calibrated on 40 loads, bounds of others hold."""
    run = tmp_path / "run"
    model = surrogate.train("series", body, run)
    assert main(["calibrate", str(run), "--loads", "40", "--seed", "1"]) == 0
    assert "fast bounds, calibrated on 40 of 40 random loads" in capsys.readouterr().out
    forces = random_loads(
        "trained", model.geometry, model.description.data.info.force.max_abs, (1, 1)
    ).draw(20, np.random.default_rng(2))
    exact = np.stack([found.displacement for found in model.correct_each(forces)])
    errors = np.linalg.norm(model.predict(forces) - exact, axis=2).max(axis=1)
    bounds = surrogate.load(run).bounds(forces).largest
    assert np.isfinite(bounds).sum() >= 15
    assert (errors > bounds).sum() <= 2
    for wrong in (["--loads", "19"], ["--seed", "-1"], ["--family", "none"]):
        assert main(["calibrate", str(run), *wrong]) == 2


def test_what_needs_samples_refuses_a_body(
    body: Path, run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = ["--out", str(tmp_path / "out")]
    for command in (
        ["train", "det-fast", "--data", str(body), *out],
        ["evaluate", str(run), "--data", str(body)],
        ["init", str(body), "--out", str(tmp_path / "out.yaml")],
    ):
        assert main(command) == 2
        said = capsys.readouterr().err
        assert "a body without samples; expected some" in said, command
        assert len(said.splitlines()) == 1
    with pytest.raises(InputError, match="a body without samples"):
        read_dataset(body)
    assert not list(tmp_path.iterdir())


def test_run_says_what_it_is(
    body: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "run"
    for _ in range(2):  # the second time nothing is done
        assert main(["train", "series", "--data", str(body), "--out", str(out)]) == 0
        assert capsys.readouterr().out.startswith(f"{out}: ready, without training")
    load = ["--load", "3.5,1:0,-0.1", "--certify", "--tolerance", "1e-4"]
    assert main(["predict", str(out), *load, "--out", str(tmp_path / "p.npz")]) == 0
