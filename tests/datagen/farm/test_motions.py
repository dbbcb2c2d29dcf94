"""Datasets of motions, and the command that lets a body move."""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from mpi4py import MPI

import datagen
from datagen.cases.body import make_body
from datagen.cases.case import read_case
from datagen.command_line import main
from datagen.farm.shard_job import ShardJob
from shared_schema.common.errors import InputError, StoppedError, WorkError
from shared_schema.layout import Arrays
from shared_schema.shard import read_shard
from tests.datagen import farm_runs

BEAM: dict[str, Any] = {
    "name": "swing",
    "mesh": {"kind": "box", "lower": [0, 0], "upper": [4, 1], "elements": [6, 2]},
    "material": {"young_modulus": 500, "poisson_ratio": 0.3, "density": 1.0},
    "supports": [{"x": 0}],
    "load": {"family": "random_node", "region": {"y": 1, "x": "> 0"}, "range": [-1, 1]},
    "time": {"step": 0.02, "duration": 1.2, "every": 4, "load": {"random": {"frequency": 1}}},
    "dataset": {"samples": 2, "seed": 5, "shard_size": 2, "test_fraction": 0.5},
}
FRAMES = "samples/frame_displacement", "samples/frame_velocity"


def written(folder: Path, **keys: Any) -> Path:
    """A case file with other keys."""
    path = folder / "case.yaml"
    path.write_text(yaml.safe_dump({**BEAM, **keys}))
    return path


def test_a_motion_goes_on_where_it_was_left(tmp_path: Path) -> None:
    """Left after 50 of 60 steps and begun anew, the frames are the same to the last bit."""
    case = read_case(written(tmp_path))
    body = make_body(case, MPI.COMM_SELF)
    whole = ShardJob(case, body, [0, 1], tmp_path / "whole")
    assert all((whole.solve_next(), whole.solve_next()))
    asked = itertools.count()  # the first question is answered by 0
    left = ShardJob(case, body, [0, 1], tmp_path / "left", lambda: bool(next(asked)))
    assert left.solve_next()
    with pytest.raises(StoppedError):
        left.solve_next()
    again = ShardJob(case, make_body(case, MPI.COMM_SELF), [0, 1], tmp_path / "left")
    assert all((again.solve_next(), again.solve_next()))
    one, other = whole.arrays(), again.arrays()
    assert one.keys() == other.keys()
    for name in one.keys() - {"samples/wall_time"}:
        assert np.array_equal(one[name], other[name]), name
    assert one["frames/time"] == pytest.approx(0.02 * np.arange(0, 61, 4))
    assert one[FRAMES[0]].shape == (2, 16, 21, 2)
    again.forget()
    assert not list((tmp_path / "left").iterdir())


def test_a_dataset_of_motions(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """`run` makes it, `check` and `info` read it, what is made for equilibria refuses it."""
    out = tmp_path / "nodal"
    manifest = datagen.run(written(tmp_path), out, comm=MPI.COMM_SELF)
    assert (manifest.samples, manifest.failed) == (2, 0)
    assert datagen.info(out)["motion"] == "16 frames to 1.2 s, 60 steps, generalised-alpha"
    assert main(["check", str(out)]) == 0
    arrays = read_shard(out / "shard-00000.h5", "nodal")
    assert np.array_equal(arrays["samples/displacement"], arrays[FRAMES[0]][:, -1])
    assert not arrays[FRAMES[0]][:, 0].any()
    assert arrays["samples/frame_factor"][0] != pytest.approx(arrays["samples/frame_factor"][1])
    for words in ("structure", "noise"):
        assert main([*words.split(), str(out), "--out", str(tmp_path / "other")]) == 2
        assert "the samples are motions, expected equilibria" in capsys.readouterr().err
    assert not (tmp_path / "other").exists()
    series = tmp_path / "series.pvd"
    assert main(["export", str(out), "--out", str(series)]) == 2
    assert "2 samples: expected --samples of one" in capsys.readouterr().err
    assert main(["export", str(out), "--samples", "1:2", "--out", str(series)]) == 0
    assert series.read_text().count("timestep") == 16
    assert 'timestep="1.2"' in series.read_text()


def test_failed_motions_are_recorded(tmp_path: Path) -> None:
    """A load that turns cells inside out fails, with the time at which it does."""
    keys = {"load": {**BEAM["load"], "range": [900, 1000]}, "time": {"step": 0.5, "duration": 1.0}}
    with pytest.raises(WorkError):
        datagen.run(written(tmp_path, **keys), tmp_path / "out", samples=1, comm=MPI.COMM_SELF)
    arrays = read_shard(tmp_path / "out" / "shard-00000.h5", "nodal")
    assert str(arrays["failed/reason"][0]).startswith("no step beyond ")
    assert arrays[FRAMES[0]].shape == (0, 3, 21, 2)


@pytest.mark.slow
@pytest.mark.mpi
def test_two_ranks_move_a_body_alike(tmp_path: Path) -> None:
    """Two ranks that share a body find what one finds, with viscosity and a let-go beam."""
    time = {"step": 0.05, "duration": 0.5, "load": "let_go", "damping": {"stiffness": 0.01}}
    case = written(tmp_path, time=time, solver={"relative_tolerance": 1e-11})
    datagen.run(case, tmp_path / "one", comm=MPI.COMM_SELF)
    result = farm_runs.execute(2, case, tmp_path / "two", "--ranks-per-solve", "2")
    assert result.returncode == 0, result.stderr
    found: list[Arrays] = [
        read_shard(tmp_path / name / "shard-00000.h5", "nodal") for name in ("one", "two")
    ]
    for name in FRAMES:
        scale = np.abs(found[0][name]).max()
        assert found[1][name] == pytest.approx(found[0][name], abs=1e-8 * scale)


def test_grips_tools_and_pressures_move_a_body(tmp_path: Path) -> None:
    """Slowly driven, a body follows its equilibria; a grip that is let go is gone."""
    slow: dict[str, Any] = {"duration": 40.0, "step": 1.0, "history": "ramp=35"}
    damped = ["time.damping={mass: 3}"]
    rope = {"rope": {"cable": [[x, 0.75] for x in (0.5, 1.5, 2.5, 3.5)], "tension": [0, 5]}}
    case = {**BEAM, "time": {**BEAM["time"], "dissipation": 0.0}, "actuators": rope}
    drives: tuple[dict[str, Any], ...] = (
        {"held": ["4,1:0,-0.4"]},
        {"tool": "sphere:2,1.3:0.5"},
        {"load": ["4,0:0,0.5"], "body_force": "0,-0.1"},
        {"actuate": ["rope=5"]},
        {"actuate": ["rope.length=2.9"]},
    )
    for given in drives:
        still = datagen.solve(case, **given)
        moved = datagen.move(case, **given, **slow, changes=damped)
        end = moved.trajectory.displacement[-1]
        assert end == pytest.approx(still.displacement, abs=2e-3 * still.largest_displacement)
    case["time"]["every"] = 1
    let_go: dict[str, Any] = {"duration": 1.0, "step": 0.02, "history": "let_go"}
    swung = datagen.move(case, held=["4,1:0,-0.4"], **let_go).trajectory
    tip = swung.displacement[:, np.flatnonzero((still.coordinates == [4, 1]).all(axis=1))[0], 1]
    assert tip[0] == pytest.approx(-0.4)
    assert tip[-1] > -0.3  # nothing holds it
    assert swung.energies[:, 2] == pytest.approx(0.0)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--step", "0"], "key 'step' = 0"),
        (["--set", "material.density=null"], "key 'material.density': missing, expected kg/m³"),
        (
            ["--tool", "sphere:2,1.3:0.5", "--tool-from", "0,2"],
            "the tool moves 2 m within one step",
        ),
        (["--history", "thrown"], "expected held, let_go, ramp=SECONDS or random=HERTZ"),
        (["--stresses"], "--start and --stresses: expected without --duration"),
        (
            ["--set", "time.scheme=energy-momentum", "--hold", "4,1:0,0.1"],
            "expected dead forces only",
        ),
    ],
)
def test_wrong_motions(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], words: list[str], said: str
) -> None:
    """One line, exit code 2, and no file."""
    content = {**BEAM, "time": {**BEAM["time"], "load": "held"}}
    out = tmp_path / "motion.npz"
    case = written(tmp_path, time=content["time"])
    command = ["solve", str(case), "--load", "4,0:0,-0.1", "--duration", "1", "--out", str(out)]
    assert main([*command, *words]) == 2
    error = capsys.readouterr().err.strip()
    assert said in error
    assert "\n" not in error
    assert not out.exists()


def test_a_series_for_paraview(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """`solve --duration` writes the frames with their times, and says the energies."""
    out = tmp_path / "motion.pvd"
    words = ["--duration", "0.08", "--load", "4,1:0,-0.1", "--out", str(out)]
    assert main(["solve", str(written(tmp_path)), *words]) == 0
    assert 'timestep="0.08"' in out.read_text()
    assert len(list((tmp_path / "motion").iterdir())) == 2
    assert "energies at the end in N m: kinetic" in capsys.readouterr().out


def test_a_case_with_time_needs_masses(tmp_path: Path) -> None:
    material = {"young_modulus": 500, "poisson_ratio": 0.3}
    with pytest.raises(InputError, match=r"key 'material\.density': missing, expected kg/m³"):
        read_case(written(tmp_path, material=material))
