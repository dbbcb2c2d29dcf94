"""Networks that come with the package: found by name, small, complete, and never changed."""

from __future__ import annotations

import json
import re
import shutil
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

import surrogate
from shared_schema.common.errors import InputError
from shared_schema.manifest import MANIFEST
from surrogate.command_line import main
from surrogate.learning.runs import shelf
from surrogate.learning.runs.config_reader import SHIPPED
from surrogate.learning.runs.folder import RunFolder
from surrogate.learning.runs.shelf import (
    KEPT,
    KEPT_IF_THERE,
    Row,
    find_run,
    shelve,
    shelved,
    size_of,
)

PACKAGE = Path(surrogate.__file__).parent
NAMES = shelved()


@pytest.fixture
def empty(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A package without networks."""
    monkeypatch.setattr(shelf, "SHELF", tmp_path / "trained")
    return tmp_path / "trained"


@pytest.fixture
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Another working directory."""
    folder = tmp_path / "elsewhere"
    folder.mkdir()
    monkeypatch.chdir(folder)
    return folder


# --- the networks themselves ----------------------------------------------------------------------


def test_sizes() -> None:
    """At most 5 MB each and 16 MB together."""
    sizes = [size_of(shelf.SHELF / name) for name in NAMES]
    assert max(sizes) <= 5e6
    assert sum(sizes) <= 16e6


@pytest.mark.parametrize("name", NAMES)
def test_files_are_those_of_a_network_and_part_of_the_package(name: str) -> None:
    files = {path.name for path in (shelf.SHELF / name).iterdir()}
    assert {*KEPT, MANIFEST} <= files <= {*KEPT, *KEPT_IF_THERE, MANIFEST}
    settings = tomllib.loads((PACKAGE / "pyproject.toml").read_text())["tool"]["setuptools"]
    packed = {p for glob in settings["package-data"]["surrogate"] for p in PACKAGE.glob(glob)}
    assert set((shelf.SHELF / name).iterdir()) <= packed


@pytest.mark.parametrize("name", NAMES)
def test_no_path_of_the_machine_of_its_training(name: str) -> None:
    def texts(content: Any) -> Iterator[str]:
        if isinstance(content, dict):
            content = list(content.values())
        if isinstance(content, list):
            for part in content:
                yield from texts(part)
        elif isinstance(content, str):
            yield content

    folder = RunFolder(shelf.SHELF / name)
    content = [yaml.safe_load(folder.config.read_text()), folder.read_evaluation()]
    assert not [text for text in texts(content) if text.startswith(("/", "~"))]


@pytest.mark.parametrize("name", NAMES)
def test_it_predicts_from_anywhere(name: str, elsewhere: Path) -> None:
    """Without loads the body rests: |u| is small against the displacements of the training, if any,
    else against the body.
    """
    model = surrogate.load(name)
    info = model.description.data.info
    largest = max(info.displacement.max_abs) or np.ptp(model.geometry.coordinates)
    tip = np.zeros(model.geometry.coordinates.shape)
    rest = np.abs(model.predict(tip)).max()
    tip[model.geometry.tip, -1] = -0.5 * info.force.max_abs[-1]
    assert rest < 0.02 * largest
    moved = model.predict(tip)[model.geometry.tip, -1]
    assert -largest < moved < -rest


def test_list(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["list"]) == 0
    networks, configurations = capsys.readouterr().out.split("\n\n")
    head, *lines = networks.splitlines()
    assert tuple(head.split()) == Row._fields
    assert [line.split()[0] for line in lines] == NAMES
    (line,) = (line for line in lines if line.startswith("beam2d_any "))
    evaluation = RunFolder(find_run("beam2d_any")).read_evaluation()
    assert " 4 × 1 m 64 " in " ".join(line.split())
    assert f"{evaluation['test']['mean_error']:.2e} m" in line
    assert line.endswith("full, fast")
    (line,) = (line for line in lines if line.startswith("finger3d "))
    assert line.endswith("full, fast")
    _, *lines = configurations.splitlines()
    assert [line.split()[0] for line in lines] == sorted(p.stem for p in SHIPPED.glob("*.yaml"))
    (line,) = (line for line in lines if line.startswith("det-fast "))
    assert "U-Net, 3 levels, c = 32" in line
    assert line.endswith("Our recipe for two CPU cores")


def test_a_network_says_what_it_is(elsewhere: Path) -> None:
    """The name of a network of the package works from any folder; 0.17 M as in its evaluation."""
    model = surrogate.load("beam2d_any")
    error = RunFolder(find_run("beam2d_any")).read_evaluation()["test"]["mean_error"]
    expected = f"Surrogate(beam2d_any, 64 nodes, load series, ē {1e6 * error:.3g} µm)"
    assert repr(model) == expected
    model = surrogate.load("finger3d")
    model.mean_error = None
    assert repr(model).endswith(", reduced network 0.17 M)")


# --- finding them ---------------------------------------------------------------------------------


def test_a_run_of_that_name_goes_first(elsewhere: Path, trained: Path) -> None:
    """A folder of that name that is no run does not."""
    (elsewhere / "beam2d_any").mkdir()
    assert find_run("beam2d_any") == shelf.SHELF / "beam2d_any"
    shutil.copytree(trained, elsewhere / "beam2d_any", dirs_exist_ok=True)
    assert find_run("beam2d_any") == Path("beam2d_any")
    assert surrogate.load("beam2d_any").description.run.name == "small"


def test_an_empty_name(elsewhere: Path) -> None:
    with pytest.raises(InputError, match=r"^run = '': expected a text or a path, not an empty"):
        surrogate.load("")


@pytest.mark.parametrize("run", ["beam3d_none", ".", "../trained", "../configs"])
def test_neither_a_run_nor_a_name(elsewhere: Path, run: str) -> None:
    with pytest.raises(
        InputError, match=r"no run there, .* a network of the package \(.*beam2d_any"
    ):
        surrogate.load(run)


def test_the_run_inside_a_folder_is_named(elsewhere: Path) -> None:
    (elsewhere / "organ" / "series").mkdir(parents=True)
    (elsewhere / "organ" / "series" / "config.yaml").touch()
    said = re.escape(str(Path("organ") / "series"))
    with pytest.raises(InputError, match=rf"did you mean '{said}'\?$"):
        surrogate.load("organ")


# --- shelving -------------------------------------------------------------------------------------


def test_shelve_keeps_what_prediction_needs(
    evaluated: Path, empty: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["shelve", str(evaluated), "small"]) == 0
    assert "trained/small: 0.0 MB" in capsys.readouterr().out
    assert {path.name for path in (empty / "small").iterdir()} == {*KEPT, MANIFEST}
    assert (evaluated / "metrics.jsonl").is_file()
    force = np.zeros((32, 2))
    force[31] = 1.0
    expected = surrogate.load(evaluated).predict(force)
    np.testing.assert_array_equal(surrogate.load("small").predict(force), expected)


def test_large_matrices_in_half_precision(
    evaluated: Path, empty: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Only where the network is too large; predictions change by rounding, 2⁻¹¹ of each weight."""
    size = size_of(shelve(evaluated, "small"))
    monkeypatch.setattr(shelf, "LARGE_MATRIX", 500)
    assert size_of(shelve(evaluated, "small")) == size
    monkeypatch.setattr(shelf, "LARGEST", size - 1)
    assert size_of(shelve(evaluated, "small")) < 0.9 * size
    force = np.zeros((32, 2))
    force[31] = 1.0
    expected, found = (surrogate.load(run).predict(force) for run in (evaluated, "small"))
    assert 0 < np.abs(found - expected).max() < 5e-3 * np.abs(expected).max()


def test_shelving_again_replaces(evaluated: Path, empty: Path) -> None:
    shelve(evaluated, "small")
    (empty / "small" / "old").touch()
    shelve(evaluated, "small")
    assert {path.name for path in (empty / "small").iterdir()} == {*KEPT, MANIFEST}
    assert [path.name for path in empty.iterdir()] == ["small"]


def test_not_evaluated_on_its_own_data(
    tmp_path: Path, trained: Path, evaluated: Path, empty: Path
) -> None:
    with pytest.raises(InputError, match="not evaluated yet"):
        shelve(trained, "small")
    run = Path(shutil.copytree(evaluated, tmp_path / "run"))
    content = RunFolder(run).read_evaluation() | {"trained_on_this_data": False}
    (run / "evaluation.json").write_text(json.dumps(content))
    RunFolder(run).seal.add([run / "evaluation.json"])
    with pytest.raises(InputError, match="evaluated on another dataset"):
        shelve(run, "small")
    assert not empty.exists()


@pytest.mark.parametrize("name", ["", "a/b", "..", "a-b", "a b"])
def test_wrong_name(evaluated: Path, empty: Path, name: str) -> None:
    with pytest.raises(InputError, match=f"NAME '{name}': expected letters"):
        shelve(evaluated, name)


def test_too_large(evaluated: Path, empty: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One network, or all together; a network does not count twice when it is replaced."""
    size = size_of(shelve(evaluated, "small"))
    monkeypatch.setattr(shelf, "LARGEST_SHELF", 1.5 * size)
    shelve(evaluated, "small")
    with pytest.raises(InputError, match="all networks of the package: "):
        shelve(evaluated, "other")
    monkeypatch.setattr(shelf, "LARGEST", size - 1)
    with pytest.raises(InputError, match=r"0\.\d MB, expected 0 at most"):
        shelve(evaluated, "small")
    assert [path.name for path in empty.iterdir()] == ["small"]


# --- the package is not changed -------------------------------------------------------------------


def test_evaluation_writes_into_a_copy(
    tmp_path: Path, evaluated: Path, data: Path, empty: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = {p.name: p.read_bytes() for p in shelve(evaluated, "small").iterdir()}
    command = ["evaluate", "small", "--data", str(data)]
    assert main(command) == 2
    assert (
        "comes with the package and is not changed; expected --out DIR" in capsys.readouterr().err
    )
    assert main([*command, "--out", str(tmp_path / "copy")]) == 0
    assert f"{tmp_path / 'copy'}: 12 test samples" in capsys.readouterr().out
    assert {p.name: p.read_bytes() for p in (empty / "small").iterdir()} == before
    found, expected = (RunFolder(run).read_evaluation() for run in (tmp_path / "copy", evaluated))
    assert found == expected
    assert (tmp_path / "copy" / "figures" / "errors.png").is_file()
    assert main([*command, "--out", str(tmp_path / "copy")]) == 2
    assert "exists, expected a new folder" in capsys.readouterr().err
