"""A published family of shapes: others read what they are given, and it has no answer."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import yaml
from mpi4py import MPI

from datagen.cases.case import read_case
from datagen.command_line import main
from datagen.farm.farm import run
from datagen.transforms.reindexing import nodal_forces_of
from shared_schema.common.files import sha256
from shared_schema.dataset_reader import DatasetReader
from tests.datagen.refusal import refusal

HERE = Path(__file__).parent
READ_PARQUET, READ_PLAID = HERE / "read_parquet.py", HERE.parent / "plaid" / "read_back.py"
SPLITS = {"train": 14, "validation": 4, "test": 2}
Arrays = dict[str, np.ndarray]


@pytest.fixture(scope="module")
def plates(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Twenty plates with another hole each."""
    folder = tmp_path_factory.mktemp("publishing") / "nodal"
    changes = ["dataset.samples=20", "dataset.shard_size=9", "dataset.test_fraction=0.1"]
    run(read_case("plate2d_shapes", changes=changes), folder, comm=MPI.COMM_SELF)
    return folder


@pytest.fixture(scope="module")
def published(plates: Path, plaid: Path) -> Path:
    """The benchmark, with predictions of zero as a baseline."""
    out, zero = plates.parent / "plates", plates.parent / "zero.npz"
    words = ["publish", str(plates), "--license", "CC-BY-4.0", "--python", str(plaid)]
    options = ["--owner", "We", "--validation", "0.2"]
    assert main([*words, *options, "--out", str(plates.parent / "first")]) == 0
    with np.load(plates.parent / "first" / "answers.npz") as answers:
        np.savez(zero, number=answers["number"], displacement=0 * answers["displacement"])
    assert main([*words, *options, "--baseline", f"none={zero}", "--out", str(out)]) == 0
    return out


def read(script: Path, python: Path, folder: Path, out: Path) -> Arrays:
    """Read a layout in the environment that has its library."""
    subprocess.run([python, script, folder, out], check=True)
    with np.load(out) as file:
        return dict(file)


def truth(plates: Path) -> dict[str, Arrays]:
    """Arrays of the dataset by name and sample number."""
    found: dict[str, Arrays] = {}
    for _, shard in DatasetReader(plates, "nodal"):
        names = ("parameters", "coordinates", "displacement")
        columns = {name: shard[f"samples/{name}"] for name in names}
        for name, values in {**columns, "force": nodal_forces_of(shard)}.items():
            found.setdefault(name, {}).update(zip(shard["samples/number"], values, strict=True))
    return found


def test_the_splits_are_the_dataset_and_the_test_has_no_answer(
    plates: Path, published: Path, plaid: Path, tmp_path: Path
) -> None:
    given, true = published / "huggingface", truth(plates)
    parquet = read(READ_PARQUET, plaid, given / "data", tmp_path / "parquet.npz")
    fields = read(READ_PLAID, plaid, published / "plaid", tmp_path / "plaid.npz")
    told = json.loads((given / "splits.json").read_text())
    assert told["seed"] == 2041
    for split, count in SPLITS.items():
        numbers = parquet[f"{split}/number"].tolist()
        assert numbers == told[split] == fields[f"{split}/number"].ravel().tolist()
        assert len(numbers) == count
        for name in ("force", "parameters", "coordinates"):
            expected = np.array([true[name][number] for number in numbers])
            np.testing.assert_array_equal(parquet[f"{split}/{name}"], expected)
        place = np.array([true["coordinates"][number] for number in numbers])
        np.testing.assert_allclose(fields[f"{split}/coordinates"], place, rtol=1e-6, atol=1e-7)
        if split != "test":
            u = np.array([true["displacement"][number] for number in numbers])
            np.testing.assert_array_equal(parquet[f"{split}/displacement"], u)
            np.testing.assert_array_equal(fields[f"{split}/displacement_y"], np.float32(u[..., 1]))
    assert sorted(number for split in SPLITS for number in told[split]) == list(range(20))
    assert np.isnan(parquet["test/displacement"]).all()
    assert not [name for name in fields if name.startswith("test/displacement")]
    checked = subprocess.run(
        [plaid.with_name("plaid-check"), published / "plaid"], capture_output=True, text=True
    )
    assert "0 error(s), 0 warning(s)" in checked.stdout


def test_the_answers_are_elsewhere(plates: Path, published: Path) -> None:
    """No file that others are given has a component of them, as it is or in single precision."""
    true = truth(plates)["displacement"]
    with np.load(published / "answers.npz") as answers:
        for number, u in zip(answers["number"], answers["displacement"], strict=True):
            np.testing.assert_array_equal(u, true[number])
            values = u[np.abs(u[:, 1]).argmax(), 1]
            for path in (each for each in published.rglob("*/*") if each.is_file()):
                content = path.read_bytes()
                assert values.tobytes() not in content
                assert np.float32(values).tobytes() not in content
    assert {path.name for path in published.iterdir()} == {"huggingface", "plaid", "answers.npz"}


def test_the_card_is_that_of_the_dataset(plates: Path, published: Path) -> None:
    _, metadata, text = (published / "huggingface" / "README.md").read_text().split("---\n", 2)
    hub, manifest = yaml.safe_load(metadata), DatasetReader(plates).manifest
    assert (hub["license"], hub["size_categories"]) == ("cc-by-4.0", ["n<1K"])
    (config,) = hub["configs"]
    assert [each["split"] for each in config["data_files"]] == list(SPLITS)
    for each in config["data_files"]:
        assert (published / "huggingface" / each["path"]).is_file()
    array = {"array2_d": {"shape": [303, 2], "dtype": "float64"}}
    assert {"name": "displacement", "dtype": array} in hub["dataset_info"]["features"]
    assert yaml.safe_load(text.partition("```yaml\n")[2].partition("```")[0]) == manifest.case
    for part in (manifest.digest, sha256(published / "answers.npz"), "owner: We", "| 100 % |"):
        assert part in text  # the worst node of predictions of zero is off by all


def scored(given: Path, *files: Path) -> tuple[int, str]:
    """Run the script that others are given; return exit code, and what it says."""
    words = [sys.executable, "-I", *map(str, (given / "huggingface" / "score.py", *files))]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    return done.returncode, done.stdout or done.stderr


def test_scores(published: Path, tmp_path: Path) -> None:
    """Of an error of 1 % of the largest displacement at one node of the first sample, by hand."""
    answers, mine = published / "answers.npz", tmp_path / "mine.npz"
    with np.load(answers) as file:
        number, u = file["number"], file["displacement"]
    error = 0.01 * np.linalg.norm(u[0], axis=1).max()
    predicted = u.copy()
    predicted[0, 7, 1] += error
    np.savez(mine, number=number[::-1], displacement=predicted[::-1])
    code, said = scored(published, mine, answers)
    found = json.loads(said)
    assert code == 0
    assert found == {
        "samples": 2,
        "mean_error": pytest.approx(error / 606 / 2),
        "relative_mean_error": pytest.approx(0.01 / 606 / 2),
        "worst_node_error": pytest.approx(0.005),
        "largest_worst_node_error": pytest.approx(0.01),
        "within_tolerance": 0.5,
    }


@pytest.mark.parametrize(
    ("change", "part"),
    [
        (lambda n, u: (n[1:], u[1:]), "no prediction for 1 of 2 samples, number"),
        (lambda n, u: (np.append(n, n[0]), np.append(u, u[:1], 0)), "each sample of the test once"),
        (lambda n, u: (n, np.where(u == u.max(), np.nan, u)), "has values that are not finite"),
        (lambda n, u: (n, u[:, 1:]), "'displacement' (2, 302, 2), expected (2, 303, 2)"),
        (lambda n, u: (n, u[0]), "expected (M,) and (M, node, component)"),
        (lambda n, u: (n, np.array(["none"])), "expected a file .npz with numbers"),
    ],
)
def test_wrong_predictions(
    published: Path, tmp_path: Path, change: Callable[..., tuple[np.ndarray, np.ndarray]], part: str
) -> None:
    with np.load(published / "answers.npz") as file:
        number, u = change(file["number"], file["displacement"])
    np.savez(tmp_path / "wrong.npz", number=number, displacement=u)
    code, said = scored(published, tmp_path / "wrong.npz", published / "answers.npz")
    assert (code, said.count("\n")) == (2, 1)
    assert part in said


def test_refusals(
    plates: Path, plaid: Path, published: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Nothing is written."""
    there = set(plates.parent.iterdir())
    words = ["publish", str(plates), "--license", "mit", "--python", str(plaid), "--out"]
    out = [*words, str(plates.parent / "none")]
    for arguments, part in (
        ([*words, str(published)], "exists, expected a new folder"),
        ([*words, str(published / "a" / "b")], f"no such folder {published / 'a'}"),
        ([*out, "--validation", "nan"], "--validation nan: 0 of 18 samples"),
        ([*out, "--baseline", "mine"], "--baseline mine: expected NAME=FILE.npz"),
        ([*out, "--baseline", "mine=nowhere.npz"], "--baseline nowhere.npz: expected a file .npz"),
    ):
        assert part in refusal(arguments, capsys)
    assert set(plates.parent.iterdir()) == there
