"""Numbers that cannot be meant: exit code 2 and one line, at once, before anything is written."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import yaml
from mpi4py import MPI

from datagen.cases.case import SHIPPED, read_case
from datagen.farm.farm import run
from tests.datagen.refusal import refusal

pytestmark = pytest.mark.timeout(60)
HUGE = 10**30


def write_case(folder: Path, shipped: str, key: str, value: Any) -> str:
    """A shipped case with one key changed, a dotted path."""
    content = yaml.safe_load((SHIPPED / f"{shipped}.yaml").read_text())
    section = content
    *above, last = key.split(".")
    for name in above:
        section = section.setdefault(name, {})
    section[last] = value
    path = folder / "case.yaml"
    path.write_text(yaml.safe_dump(content))
    return str(path)


@pytest.mark.parametrize(
    ("shipped", "key", "value", "said"),
    [
        ("beam2d", "load.range", [-1.7e308, 1.7e308], "range.0' = -1.7e+308"),
        ("beam2d", "load.range", [-2.5, 1e13], "range.1' = 10000000000000.0"),
        ("beam2d", "solver", {"max_iterations": 1e30}, "solver.max_iterations' = 1e+30"),
        ("beam2d", "solver", {"max_iterations": HUGE}, "solver.max_iterations' = 1000"),
        ("beam2d", "solver", {"smallest_step": 5e-324}, "solver.smallest_step' = 5e-324"),
        ("beam2d", "dataset.samples", HUGE, "dataset.samples' = 1000"),
        ("beam2d", "dataset.samples", True, "dataset.samples' = True"),
        ("beam2d", "dataset.samples", "6", "dataset.samples' = '6'"),
        ("beam2d", "dataset.samples", 6.0, "dataset.samples' = 6.0"),
        ("beam2d", "dataset", {"samples": 10**9, "shard_size": 10**9}, "dataset.s"),
        ("beam2d", "dataset", {"samples": 10**9}, "2000000 shards, expected at most 100000"),
        ("beam2d", "dataset.seed", HUGE, "dataset.seed' = 1000"),
        ("beam2d", "dataset.seed", -1, "dataset.seed' = -1"),
        ("beam2d", "mesh.elements", [100_000, 100_000], "'mesh': a mesh of 10000200001 nodes: nee"),
        ("beam2d", "mesh.elements", [HUGE, 3], "mesh.elements.0' = 1000"),
        ("beam2d", "mesh.elements", [True, 3], "mesh.elements.0' = True"),
        ("beam2d", "mesh.upper", [1e308, 1], "mesh.upper.0' = 1e+308"),
        ("beam2d", "mesh.upper", [1e-300, 1], "the smallest element is 6.67e-302 m long"),
        ("beam2d", "mesh.upper", ["4", 1], "mesh.upper.0' = '4'"),
        ("beam3d", "mesh.elements", [900, 900, 900], "needs 1.02e+04 GiB of memory at least"),
        ("lshape2d", "mesh.arm.elements", [HUGE, 1], "mesh.arm.elements.0' = 1000"),
        ("lshape2d", "mesh.block.height", 1e300, "mesh.block.height' = 1e+300"),
        ("beam2d", "material.young_modulus", 1e300, "material.young_modulus' = 1e+300"),
        ("beam2d", "supports", [{"x": "> nan"}], "supports.0.x' = '> nan'"),
        ("beam2d_sweep", "load.steps", HUGE, "steps' = 1000"),
        ("beam2d_multiple", "load.count", [1, HUGE], "count"),
        ("beam2d", "name", "b" * 300, "key 'name'"),
    ],
)
def test_in_a_case(
    shipped: str,
    key: str,
    value: Any,
    said: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    path = write_case(tmp_path, shipped, key, value)
    assert said in refusal(["run", path, "--out", str(tmp_path / "nodal")], capsys)
    assert [file.name for file in tmp_path.iterdir()] == ["case.yaml"]


@pytest.fixture(scope="module")
def nodal(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("data") / "nodal"
    run(read_case("beam2d", samples=4), folder, comm=MPI.COMM_SELF)
    return folder


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["structure", "--grid", "100000,100000"], "--grid 100000,100000: needs "),
        (["structure", "--grid", f"{HUGE},3"], f"--grid {HUGE},3: needs 1"),
        (["structure", "--grid", "1,3"], "--grid 1,3: expected 2 numbers of grid points"),
        (["structure", "--order", "random", "--order-seed", "-1"], "--order-seed -1: expected"),
        (["structure", "--order-seed", f"{HUGE}"], f"--order-seed {HUGE}: expected a number from"),
        (["noise", "--seed", "-1"], "--seed -1: expected a number from 0 to"),
        (["noise", "--seed", f"{HUGE}"], f"--seed {HUGE}: expected a number from 0"),
        (["noise", "--threshold", "inf"], "--threshold inf: expected a positive number"),
        (["noise", "--relative", "nan"], "--relative nan: expected a number between 0 and 1"),
    ],
)
def test_on_the_command_line(
    words: list[str],
    said: str,
    nodal: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    step, *options = words
    assert said in refusal([step, str(nodal), "--out", str(tmp_path / "out"), *options], capsys)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("samples", ["0", "-3", f"{HUGE}"])
def test_samples_of_a_run(samples: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["run", "beam2d", "--out", str(tmp_path / "nodal"), "--samples", samples]
    assert f"key 'dataset.samples' = {samples}" in refusal(words, capsys)
    assert list(tmp_path.iterdir()) == []
