"""The command `datagen` as its users call it: files, exit codes, one line per error."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import meshio
import numpy as np
import pytest

import datagen
from datagen.cases.case import SHIPPED, read_case
from datagen.command_line import main
from tests.datagen.refusal import refusal

CORNER = "4,1:0,-2.5"
LINE = (
    r"datagen solve beam2d: (\d+)/100 % of the load, .*, Newton step \d+ to .* of it, residual .* N"
)


def test_solve_writes_npz(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "a.npz"
    assert main(["solve", "beam2d", "--load", CORNER, "--out", str(out)]) == 0
    assert "largest displacement" in capsys.readouterr().out
    with np.load(out) as file:
        assert sorted(file) == ["coordinates", "displacement", "force"]
        assert all(file[name].shape == (64, 2) for name in file)
        tip = int(np.linalg.norm(file["coordinates"] - [4, 1], axis=1).argmin())
        assert file["force"].sum(axis=0).tolist() == [0.0, -2.5]
        assert file["force"][tip].tolist() == [0.0, -2.5]
        assert file["displacement"][tip, 1] < -1.0


def test_solve_from_a_start(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    start, out = tmp_path / "start.npz", tmp_path / "a.npz"
    main(["solve", "beam2d", "--load", "4,1:0,-2.45", "--out", str(start)])
    arguments = ["solve", "beam2d", "--load", CORNER, "--out", str(out)]
    main(arguments)
    with np.load(out) as file:
        expected = file["displacement"]
    capsys.readouterr()
    assert main([*arguments, "--start", str(start)]) == 0
    assert f"from {start}, 1 load steps" in capsys.readouterr().out
    with np.load(out) as file:
        np.testing.assert_allclose(file["displacement"], expected, atol=1e-8)
    out.unlink()
    error = refusal([*arguments, "--start", str(tmp_path / "none.npz")], capsys)
    assert "--start" in error
    assert not out.exists()


def test_solve_shows_its_progress(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A line a Newton step on stderr: parts of the load that grow; stdout is as without."""
    command = ["solve", "beam2d", "--load", CORNER, "--set", "solver.first_step=0.3"]
    command += ["--out", str(tmp_path / "a.npz")]
    assert main(command) == 0
    plain = capsys.readouterr()
    assert plain.err == ""  # it takes less than ten seconds
    monkeypatch.setattr("shared_schema.common.progress.LINE_EVERY", 0.0)
    assert main(command) == 0
    shown = capsys.readouterr()
    assert shown.out.splitlines()[0] == plain.out.splitlines()[0]
    steps, iterations = map(int, re.findall(r"(\d+) (?:load steps|Newton)", shown.out)[:2])
    lines = shown.err.splitlines()
    assert len(lines) == iterations
    parts = [int(re.fullmatch(LINE, line)[1]) for line in lines]  # type: ignore[index]
    assert parts == sorted(parts)
    assert {0, 30} <= set(parts)
    assert steps == sum("Newton step 1 to" in line for line in lines) >= 2


def test_solutions_in_python_show_nothing(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("shared_schema.common.progress.LINE_EVERY", 0.0)
    datagen.solve("beam2d", CORNER)
    assert capsys.readouterr() == ("", "")


@pytest.mark.parametrize(
    "words", [["solve", "beam2d", "--load", CORNER], ["--help"], ["solve", "--help"]]
)
def test_output_that_nobody_reads(tmp_path: Path, words: list[str]) -> None:
    """`datagen solve … | head`: no complaint, PETSc's neither; the fields are written."""
    out = tmp_path / "a.npz"
    more = [] if "--help" in words else ["--out", str(out)]
    command = [sys.executable, "-m", "datagen.command_line", *words, *more]
    reader, writer = os.pipe()
    os.close(reader)
    with os.fdopen(writer, "wb") as pipe:
        done = subprocess.run(command, stdout=pipe, stderr=subprocess.PIPE, check=False, text=True)
    assert done.stderr == ""
    assert done.returncode == 1
    assert out.is_file() == bool(more)


def test_a_cache_that_cannot_be_written(tmp_path: Path) -> None:
    """One line that says which folder, and which variable leads elsewhere."""
    out, file = tmp_path / "a.npz", tmp_path / "file"
    file.touch()
    words = ["solve", "beam2d", "--load", CORNER, "--out", str(out)]
    done = subprocess.run(
        [sys.executable, "-m", "datagen.command_line", *words],
        env={**os.environ, "XDG_CACHE_HOME": str(file)},
        capture_output=True,
        check=False,
        text=True,
    )
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert f"'{file}/fenics' cannot be written to" in done.stderr
    assert "set the environment variable XDG_CACHE_HOME" in done.stderr
    assert not out.exists()


def test_loads_at_several_nodes_act_together(tmp_path: Path) -> None:
    """Two half loads at one node act as the whole load."""
    whole, halves = tmp_path / "whole.npz", tmp_path / "halves.npz"
    main(["solve", "beam2d", "--load", CORNER, "--out", str(whole)])
    half = ["--load", "4,1:0,-1.25"]
    main(["solve", "beam2d", *half, *half, "--out", str(halves)])
    with np.load(whole) as a, np.load(halves) as b:
        assert np.array_equal(a["displacement"], b["displacement"])
    both = tmp_path / "both.npz"
    assert main(["solve", "beam2d", "--load", CORNER, "--load", "4,0:1,0", "--out", str(both)]) == 0


@pytest.mark.parametrize("suffix", ["vtu", "xdmf"])
def test_solve_writes_what_meshio_reads(tmp_path: Path, suffix: str) -> None:
    out, npz = tmp_path / f"a.{suffix}", tmp_path / "a.npz"
    for path in (out, npz):
        assert main(["solve", "beam2d", "--load", CORNER, "--out", str(path)]) == 0
    mesh = meshio.read(out)
    assert [(block.type, block.data.shape) for block in mesh.cells] == [("quad", (45, 4))]
    with np.load(npz) as file:
        for name in ("force", "displacement"):
            assert mesh.point_data[name][:, :2] == pytest.approx(file[name], abs=1e-12)
            assert not mesh.point_data[name][:, 2:].any()
        assert mesh.points[:, :2] == pytest.approx(file["coordinates"])


def test_volumetric_term_changes_the_result(tmp_path: Path) -> None:
    """At these loads the two terms differ by 1e-4 to 1e-2 of the displacement."""
    found = []
    for name in ("paper", "quadratic"):
        out = tmp_path / f"{name}.npz"
        arguments = ["solve", "beam2d", "--load", CORNER, "--volumetric", name, "--out", str(out)]
        assert main(arguments) == 0
        with np.load(out) as file:
            found.append(file["displacement"])
    relative = np.linalg.norm(found[0] - found[1]) / np.linalg.norm(found[0])
    assert 1e-4 < relative < 1e-2


def test_no_equilibrium_is_exit_1(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "a.npz"
    assert main(["solve", "beam2d", "--load", "4,1:0,-1e6", "--out", str(out)]) == 1
    error = capsys.readouterr().err
    assert error.startswith("datagen: failed: no equilibrium found")
    assert error.count("\n") == 1
    assert not out.exists()


@pytest.mark.parametrize(
    ("load", "said"),
    [
        ("4,0.9:0,-1", "no node stands there, the nearest is at 4,1"),
        ("0,1:0,-1", "the node is clamped"),
        ("4,1:0,nan", "finite"),
        ("4,1:0,inf", "finite"),
        ("4,1,0:0,-1,0", "expected X,Y:FX,FY"),
        ("4,1", "expected X,Y:FX,FY"),
        ("a,b:c,d", "expected X,Y:FX,FY"),
    ],
)
def test_wrong_loads(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], load: str, said: str
) -> None:
    out = tmp_path / "a.npz"
    error = refusal(["solve", "beam2d", "--load", load, "--out", str(out)], capsys)
    assert said in error
    assert load in error
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("out", ["a.txt", "a", "missing/a.npz"])
def test_wrong_file_names(tmp_path: Path, capsys: pytest.CaptureFixture[str], out: str) -> None:
    refusal(["solve", "beam2d", "--load", CORNER, "--out", str(tmp_path / out)], capsys)
    assert list(tmp_path.iterdir()) == []


def test_run_structure_check_info(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    nodal, grid = str(tmp_path / "nodal"), str(tmp_path / "grid")
    assert main(["run", "beam2d", "--samples", "40", "--out", nodal]) == 0
    assert main(["structure", nodal, "--out", grid]) == 0
    assert main(["check", nodal]) == 0
    assert main(["check", grid]) == 0
    capsys.readouterr()
    assert main(["info", nodal]) == 0
    table = capsys.readouterr().out
    assert "40 solved, 0 failed" in table
    assert "64 nodes, 45 cells, 128 DOFs" in table
    assert main(["info", grid]) == 0
    assert "38 train, 2 test" in capsys.readouterr().out


def test_one_flipped_bit_is_found(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    nodal = tmp_path / "nodal"
    main(["run", "beam2d", "--samples", "20", "--out", str(nodal)])
    for name in ("shard-00000.h5", "manifest.json"):
        path = nodal / name
        intact = path.read_bytes()
        for position in np.random.default_rng(0).integers(len(intact) * 8, size=25):
            damaged = bytearray(intact)
            damaged[position // 8] ^= 1 << (position % 8)
            path.write_bytes(damaged)
            assert main(["check", str(nodal)]) != 0, (name, position)
        path.write_bytes(intact)
    assert main(["check", str(nodal)]) == 0
    capsys.readouterr()


@pytest.mark.parametrize(
    "arguments",
    [
        ["run", "beam9d", "--out", "new"],
        ["run", "beam2d", "--samples", "0", "--out", "new"],
        ["structure", "nowhere", "--out", "new"],
        ["check", "nowhere"],
        ["info", "nowhere"],
    ],
)
def test_wrong_input_is_exit_2_and_one_line(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    arguments: list[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(arguments) == 2
    captured = capsys.readouterr()
    assert captured.err.startswith("datagen: error: ") or arguments[0] == "check"
    assert "Traceback" not in captured.err
    assert list(tmp_path.iterdir()) == []


def test_list_has_a_line_for_each_case(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Names of cases work from any folder."""
    monkeypatch.chdir(tmp_path)
    assert main(["list"]) == 0
    _, *lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines] == sorted(p.stem for p in SHIPPED.glob("*.yaml"))
    (line,) = (line for line in lines if line.startswith("beam2d_any "))
    assert " 15 × 3 " in line
    assert " 6000 " in line
    assert "one to four random nodal forces" in line
    for name in ("beam2d", "finger3d"):
        assert read_case(name).name == name


def test_a_name_that_is_not_utf8(tmp_path: Path) -> None:
    """A file of a system with Latin-1 names, which dolfinx cannot read from the command line."""
    out = os.fsencode(tmp_path) + b"/caf\xe9.npz"
    code = "import sys; from datagen.command_line import main; sys.exit(main())"
    words = [sys.executable, "-c", code, "solve", "beam2d", "--load", CORNER, "--out"]
    done = subprocess.run([*words, os.fsdecode(out)], capture_output=True, check=False)
    assert done.returncode == 0
    assert Path(os.fsdecode(out)).is_file()
