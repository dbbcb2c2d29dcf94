"""What the commands do, in Python: one call each, with the same result."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import datagen
from datagen.command_line import main

LOAD = "4,1:0,-2.5"


@pytest.fixture(scope="module")
def solution() -> datagen.Solution:
    return datagen.solve("beam2d", LOAD, stresses=True)


@pytest.fixture(scope="module")
def nodal(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("python") / "nodal"
    manifest = datagen.run("beam2d", folder, samples=4)
    assert (manifest.samples, manifest.failed) == (4, 0)
    return folder


def test_the_import_loads_no_library() -> None:
    """The command fixes thread counts before numpy loads, and only users of MPI start it."""
    code = "import datagen, sys; print({'numpy', 'mpi4py', 'dolfinx'} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "set()\n"


def test_every_public_name_is_found() -> None:
    assert set(datagen.__all__) <= set(dir(datagen))
    for name in datagen.__all__:
        assert getattr(datagen, name) is not None
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        getattr(datagen, "nothing")  # noqa: B009


@pytest.mark.parametrize("suffix", [".npz", ".vtu", ".xdmf"])
def test_a_solution_saves_what_the_command_writes(
    solution: datagen.Solution, suffix: str, tmp_path: Path
) -> None:
    ours, theirs = tmp_path / f"a{suffix}", tmp_path / f"b{suffix}"
    solution.save(ours)
    assert main(["solve", "beam2d", "--load", LOAD, "--stresses", "--out", str(theirs)]) == 0
    if suffix == ".npz":
        with np.load(ours) as a, np.load(theirs) as b:
            assert a.files == b.files
            assert all(np.array_equal(a[name], b[name]) for name in a.files)
    else:
        assert ours.read_bytes() == theirs.read_bytes()


def test_what_a_solution_says_of_itself(solution: datagen.Solution, tmp_path: Path) -> None:
    """The reactions balance the load; the drawing has an arrow for it."""
    assert "beam2d" in repr(solution)
    assert f"{solution.report.newton_iterations} Newton iterations" in repr(solution)
    assert solution.reactions.sum(axis=0) == pytest.approx([0, 2.5], abs=1e-6)
    assert solution.largest_displacement == pytest.approx(1.05286, rel=1e-5)
    solution.plot().savefig(tmp_path / "a.png")
    assert (tmp_path / "a.png").stat().st_size > 10_000


def test_a_load_is_text_or_forces_at_all_nodes(solution: datagen.Solution) -> None:
    again = datagen.solve("beam2d", solution.force, start=solution.displacement)
    assert again.origin == "start"
    assert again.displacement == pytest.approx(solution.displacement, abs=1e-9)
    assert again.stresses == {}
    content = datagen.read_case("beam2d").plain()
    assert datagen.solve(content, [LOAD]).displacement == pytest.approx(solution.displacement)


@pytest.mark.parametrize(
    ("load", "options", "words"),
    [
        ((), {}, "no load"),
        (np.zeros((3, 2)), {}, r"load of shape \(3, 2\): expected \(64, 2\)"),
        (np.ones((64, 2)), {}, "is held in x"),
        (LOAD, {"start": np.zeros((3, 2))}, r"start of shape \(3, 2\)"),
        (None, {}, "load = None: expected a sequence, each a text"),
        (3, {}, "load = 3: expected a sequence"),
        (b"x", {}, "load = b'x': expected a sequence"),
        ([[1, 2]], {}, r"load = \[\[1, 2\]\]: expected a sequence"),
        (Path("a.csv"), {}, "load = .*: expected a sequence"),
        (np.array(1.0), {}, r"load of shape \(\): expected \(64, 2\)"),
        (np.full((64, 2), 1j), {}, "nodal forces are complex, expected real numbers"),
        (np.ma.masked_array(np.zeros((64, 2)), True), {}, "nodal forces are a masked array"),
        (LOAD, {"start": 3}, "start = 3: expected a text or a path"),
        (LOAD, {"start": b"x"}, "start = b'x': expected a text or a path"),
        (LOAD, {"start": np.full((64, 2), 1j)}, "displacements to start from are complex"),
        (LOAD, {"changes": np.array(1.0)}, r"changes = array\(1.\): expected a sequence"),
        (LOAD, {"changes": ["mesh.kind=ball"]}, "--set mesh.kind=ball"),
    ],
)
def test_wrong_input(load: object, options: dict[str, object], words: str) -> None:
    with pytest.raises(datagen.InputError, match=words):
        datagen.solve("beam2d", load, **options)  # type: ignore[arg-type]


def test_an_empty_path_is_not_the_working_directory(
    solution: datagen.Solution, nodal: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    out = tmp_path / "out"
    calls: list[Callable[[], object]] = [
        lambda: datagen.run("beam2d", "", samples=2),
        lambda: datagen.run("beam2d", out, samples=2, loads=""),
        lambda: datagen.structure(nodal, ""),
        lambda: datagen.structure("", out),
        lambda: datagen.add_noise(nodal, "", relative=0.1),
        lambda: datagen.add_noise("", out, relative=0.1),
        lambda: datagen.export(nodal, ""),
        lambda: datagen.export("", out),
        lambda: datagen.export_plaid(nodal, ""),
        lambda: datagen.export_plaid("", out),
        lambda: datagen.publish(nodal, "", license="mit"),
        lambda: datagen.plot(nodal, ""),
        lambda: datagen.plot("", out),
        lambda: datagen.info(""),
        lambda: datagen.check(""),
        lambda: datagen.read_case(""),
        lambda: datagen.solve("", LOAD),
        lambda: datagen.solve("beam2d", LOAD, start=""),
        lambda: solution.save(""),
    ]
    for call in calls:
        with pytest.raises(datagen.InputError, match=r"^\w+ = '': expected .*not an empty text$"):
            call()
    assert not list(tmp_path.iterdir())


def test_a_case_that_is_read_takes_no_other_values() -> None:
    case = datagen.read_case("beam2d", samples=3)
    assert datagen.read_case(case) is case
    with pytest.raises(datagen.InputError, match="is read already"):
        datagen.read_case(case, samples=4)


def test_a_dataset_from_its_cases_to_its_figures(nodal: Path, tmp_path: Path) -> None:
    info = datagen.structure(nodal, tmp_path / "grid").structured
    assert info is not None
    assert info.grid_shape == (16, 4)
    assert datagen.check(nodal) == datagen.check(str(tmp_path / "grid")) == []
    assert datagen.info(nodal)["samples"] == "4 solved, 0 failed"
    assert datagen.export(nodal, tmp_path / "a.xdmf", samples=range(1, 3)) == [1, 2]
    assert datagen.plot(nodal, tmp_path / "a.png", samples=[3, 0]) == [3, 0]
    assert datagen.add_noise(nodal, tmp_path / "noisy", seed=1).samples == 4


def test_cases_and_their_keys() -> None:
    assert "beam2d" in [case.name for case in datagen.shipped_cases()]
    assert "load" in datagen.case_schema()["properties"]
    assert "material" in [key.name for key in datagen.case_keys()]
