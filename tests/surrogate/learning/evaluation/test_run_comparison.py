"""Runs beside each other: the numbers are those of their evaluations."""

from __future__ import annotations

import csv
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from shared_schema.common.errors import InputError
from surrogate.command_line import main
from surrogate.learning.evaluation.run_comparison import Comparison, compare
from surrogate.learning.runs.folder import RunFolder
from surrogate.learning.runs.shelf import find_run


@pytest.fixture(scope="module")
def short(make_run: Callable[..., Path]) -> Path:
    """A run of one epoch that is not evaluated."""
    return make_run(epochs=1)


def test_numbers_are_those_of_the_evaluations(
    evaluated: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    numbers = tmp_path / "errors.csv"
    assert main(["compare", str(evaluated), "beam2d_any", "--out", str(numbers)]) == 0
    captured = capsys.readouterr()
    head, *lines = captured.out.splitlines()
    assert head.startswith("run ")
    assert [line.split()[0] for line in lines] == [evaluated.name, "beam2d_any"]
    content = RunFolder(evaluated).read_evaluation()
    assert f"{content['test']['mean_error']:.2e} m" in lines[0]
    assert "different datasets" in captured.err
    with numbers.open() as file:
        first, second = csv.DictReader(file)
    assert float(first["std_error"]) == content["test"]["std_error"]
    seconds = RunFolder(find_run("beam2d_any")).read_evaluation()["training_seconds"]
    assert float(second["minutes"]) == pytest.approx(seconds / 60, rel=1e-4)


def test_on_one_dataset(evaluated: Path, short: Path, data: Path) -> None:
    """Runs need no evaluation then; forty epochs err less than one. Nothing is written."""
    before = sorted(short.rglob("*"))
    long, one = compare([evaluated, short], dataset=data).runs
    stored = RunFolder(evaluated).read_evaluation()["test"]
    assert long.mean_error == pytest.approx(stored["mean_error"])
    assert long.mean_error < one.mean_error
    assert long.data == one.data
    assert (long.epochs, one.epochs) == (40, 1)
    assert long.run != one.run  # both folders are called run
    assert sorted(short.rglob("*")) == before


def test_units_of_the_cases(evaluated: Path) -> None:
    """A run in mm beside one in m is drawn in the unit of the first; feet are not converted."""
    (run,) = compare([evaluated]).runs
    small = replace(run, unit="mm")
    text = repr(Comparison((small, run)))
    assert f"{run.mean_error:.2e} mm" in text
    assert f"{run.mean_error:.2e} m " in text
    (axes,) = Comparison((small, run)).plot().axes
    assert axes.get_xlabel() == "error on the test split [mm]"
    mean = np.asarray(axes.lines[0].get_xdata())
    np.testing.assert_allclose(mean, [run.mean_error, 1e3 * run.mean_error])
    feet = replace(run, unit="ft")
    assert Comparison((feet, feet)).plot().axes[0].get_xlabel().endswith("[ft]")
    with pytest.raises(InputError, match="the runs are in ft and m: expected one unit of length"):
        Comparison((feet, run)).plot()


def test_refusals(short: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for words, part in (
        ([str(short)], "not evaluated yet"),
        (["nowhere"], "no run there"),
        (["beam2d_any", "--figure", "errors.txt"], "expected a file name ending in .png"),
    ):
        assert main(["compare", *words]) == 2
        assert part in capsys.readouterr().err
