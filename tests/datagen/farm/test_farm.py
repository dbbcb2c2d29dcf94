"""The farm: the same dataset by one process or many, killed or not; its plan."""

from __future__ import annotations

import heapq
import os
import shutil
import signal
import subprocess
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from mpi4py import MPI

from datagen.cases.case import SHIPPED, Case, read_case
from datagen.farm.farm import run
from datagen.farm.work_desk import Piece, plan
from shared_schema.checker import check_dataset
from shared_schema.common.errors import InputError
from shared_schema.manifest import read_manifest, write_manifest
from shared_schema.samples.journal import Journal
from shared_schema.shard import read_shard
from shared_schema.stiffness import STIFFNESS_FILE
from tests.datagen.farm_runs import (
    ENVIRONMENT,
    all_end,
    assert_near,
    assert_same,
    command,
    datagen,
    execute,
    held,
    pids_of,
    recorded,
    start,
    wait_until,
    write_case,
)
from tools.open_mpi import without_launcher

STOPPED = """
import os, signal, sys
from datagen.command_line import main
from datagen.farm.shard_job import ShardJob
solve_next = ShardJob.solve_next
def solve_and_stop(job):
    if job.number == 100:
        os.kill(os.getpid(), signal.SIGTERM)
    return solve_next(job)
ShardJob.solve_next = solve_and_stop
sys.exit(main())
"""
SIZE = 50  # number of samples of a shard


@pytest.fixture(scope="module")
def case_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_case(tmp_path_factory.mktemp("case"))


@pytest.fixture(scope="module")
def case(case_file: Path) -> Case:
    return read_case(str(case_file))


@pytest.fixture(scope="module")
def serial(case: Case, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("serial") / "nodal"
    run(case, folder, comm=MPI.COMM_SELF)
    return folder


def test_every_sample_is_in_one_shard(case: Case, serial: Path) -> None:
    """120 samples in shards of 25: 4 full ones and one of 20."""
    assert case.dataset.shards == 5
    numbers = [n for k in range(5) for n in case.dataset.samples_of(k)]
    assert numbers == list(range(120))
    found = [
        read_shard(serial / entry.file, "nodal")["samples/number"]
        for entry in read_manifest(serial).shards
    ]
    assert np.concatenate(found).tolist() == numbers
    assert check_dataset(serial) == []
    assert not (serial / ".journal").exists()


@pytest.mark.mpi
def test_many_processes_make_what_one_makes(case_file: Path, serial: Path, tmp_path: Path) -> None:
    result = execute(3, case_file, tmp_path / "nodal")
    assert result.returncode == 0, result.stderr
    assert "120 samples solved, 0 failed" in result.stdout
    assert check_dataset(tmp_path / "nodal") == []
    assert_same(serial, tmp_path / "nodal")


@pytest.mark.faults
@pytest.mark.mpi
@pytest.mark.slow
@pytest.mark.parametrize("ranks", [0, 2])
def test_killed_and_resumed_is_uninterrupted(tmp_path: Path, ranks: int) -> None:
    """SIGKILL of everything half-way; the second start makes what is missing, and no more."""
    case_file = write_case(tmp_path, samples=240, shard_size=20)
    killed, whole = tmp_path / "killed", tmp_path / "whole"
    with subprocess.Popen(
        held(command(ranks, case_file, killed), tmp_path / "gate"),
        env=ENVIRONMENT,
        start_new_session=True,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    ) as process:
        wait_until(lambda: recorded(killed) >= 5, process)
        os.killpg(process.pid, signal.SIGKILL)
    for pid in pids_of(killed):  # ranks are in groups of their own
        with suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)
    assert all_end(killed, within=60)
    done = {p.name: p.stat().st_mtime_ns for p in killed.glob("shard-*.h5")}
    assert 5 <= len(done) < 12
    assert not (killed / "manifest.json").exists()

    result = execute(ranks, case_file, killed)
    assert result.returncode == 0, result.stderr
    kept = [name for name, time_ in done.items() if (killed / name).stat().st_mtime_ns == time_]
    assert len(kept) >= len(done) - 2  # a shard without its entry yet is made again
    assert check_dataset(killed) == []
    run(read_case(str(case_file)), whole, comm=MPI.COMM_SELF)
    assert_same(whole, killed)


@pytest.mark.mpi
@pytest.mark.slow
def test_ranks_that_share_a_multigrid_solve_find_the_same(tmp_path: Path) -> None:
    """One body in space distributed over two ranks: hierarchies, and so the steps, are others."""
    content = yaml.safe_load((SHIPPED / "beam3d.yaml").read_text())
    content["mesh"]["elements"] = [14, 5, 5]
    content["dataset"] |= {"samples": 6, "shard_size": 3}
    case_file = tmp_path / "case.yaml"
    case_file.write_text(yaml.safe_dump(content))
    run(read_case(case_file), tmp_path / "alone", comm=MPI.COMM_SELF)
    result = execute(2, case_file, tmp_path / "shared", "--ranks-per-solve", "2")
    assert result.returncode == 0, result.stderr
    assert_near(tmp_path / "alone", tmp_path / "shared")


@pytest.mark.mpi
def test_wrong_input_of_many_ranks(tmp_path: Path) -> None:
    """An error that only the mesh shows ends all ranks, and one prints it."""
    case_file = write_case(tmp_path, region={"y": 1.0})
    result = execute(2, case_file, tmp_path / "nodal")
    assert result.returncode == 2
    assert without_launcher(result.stderr).startswith("datagen: error: ")
    assert result.stderr.count("clamped node at 0,1") == 1
    assert not (tmp_path / "nodal").exists()


@pytest.mark.mpi
def test_a_file_here_of_a_shipped_name_is_mentioned_once(tmp_path: Path) -> None:
    """Every rank reads the case, one says that the shipped one is taken."""
    (tmp_path / "beam2d.yaml").write_text("name: mine")
    paths = [str(Path.cwd()), *filter(None, [os.environ.get("PYTHONPATH")])]
    words = ("run", "beam2d", "--out", "nodal", "--ranks-per-solve", "3")
    result = subprocess.run(
        datagen(*words, ranks=2),
        env=ENVIRONMENT | {"PYTHONPATH": os.pathsep.join(paths)},
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert without_launcher(result.stderr).splitlines() == [
        "datagen: warning: case 'beam2d': the shipped one is read; "
        "the file here is './beam2d.yaml'",
        "datagen: error: --ranks-per-solve 3: expected a divisor of the 2 ranks there are",
    ]


@pytest.mark.mpi
def test_mpirun_is_quiet_if_asked(tmp_path: Path) -> None:
    """`mpirun -q` leaves mpirun's own banner out, as the page on troubles says."""
    words = datagen("run", "no-such-case", "--out", tmp_path / "nodal", ranks=2)
    version = subprocess.run([words[0], "--version"], capture_output=True, text=True, check=True)
    if " 4." not in version.stdout:
        pytest.skip("Open MPI 5 has no such option")
    loud = {key: value for key, value in ENVIRONMENT.items() if "execute_quiet" not in key}
    result = subprocess.run(
        [words[0], "-q", *words[1:]], env=loud, capture_output=True, text=True, check=False
    )
    said = without_launcher(result.stderr)
    assert (result.returncode, said.count("\n")) == (2, 1)
    assert said.startswith("datagen: error: case 'no-such-case': no such file")


@pytest.mark.faults
@pytest.mark.mpi
@pytest.mark.slow
@pytest.mark.parametrize("ranks", [0, 2])
def test_asked_to_stop(tmp_path: Path, ranks: int) -> None:
    """SIGTERM to one rank ends all after their sample; what was solved is kept and not redone."""
    case_file = write_case(tmp_path, samples=240, shard_size=80)
    out = tmp_path / "nodal"
    words = command(ranks, case_file, out)
    program = words.index("-m")
    with start([*words[:program], "-c", STOPPED, *words[program + 2 :]]) as process:
        _, said = process.communicate(timeout=120)
    assert process.returncode == 1
    assert "stopped; resume with the same command" in said
    parts = [read_shard(path, "nodal") for path in (out / ".journal").glob("part-*.h5")]
    kept = np.concatenate([part["samples/wall_time"] for part in parts])
    assert 0 < len(kept) < 200
    assert not (out / "manifest.json").exists()

    assert execute(ranks, case_file, out).returncode == 0
    assert check_dataset(out) == []
    shards = [read_shard(path, "nodal") for path in sorted(out.glob("shard-*.h5"))]
    assert np.isin(kept, np.concatenate([shard["samples/wall_time"] for shard in shards])).all()
    whole = tmp_path / "whole"
    run(read_case(str(case_file)), whole, comm=MPI.COMM_SELF)
    assert_same(whole, out)


def test_a_complete_dataset_is_left_alone(case: Case, serial: Path) -> None:
    before = {p.name: p.stat().st_mtime_ns for p in serial.glob("shard-*.h5")}
    digest = read_manifest(serial).digest
    run(case, serial, comm=MPI.COMM_SELF)
    assert {p.name: p.stat().st_mtime_ns for p in serial.glob("shard-*.h5")} == before
    assert read_manifest(serial).digest == digest


@pytest.mark.faults
def test_a_damaged_shard_is_made_again(case: Case, serial: Path, tmp_path: Path) -> None:
    folder = tmp_path / "nodal"
    run(case, folder, comm=MPI.COMM_SELF)
    shard = folder / "shard-00002.h5"
    shard.write_bytes(shard.read_bytes()[:1000])
    (folder / "shard-00003.h5").unlink()
    assert check_dataset(folder) != []
    run(case, folder, comm=MPI.COMM_SELF)
    assert check_dataset(folder) == []
    assert_same(serial, folder)


@pytest.mark.faults
@pytest.mark.parametrize("content", [None, b"", b"half"])
def test_a_damaged_stiffness_is_made_again(
    case: Case, serial: Path, tmp_path: Path, content: bytes | None
) -> None:
    """The same bytes; no shard is touched."""
    folder = shutil.copytree(serial, tmp_path / "nodal")
    before = {p.name: p.stat().st_mtime_ns for p in folder.glob("shard-*.h5")}
    path = folder / STIFFNESS_FILE
    if content is None:
        path.unlink()
    else:
        path.write_bytes(content)
    assert check_dataset(folder) != []
    run(case, folder, comm=MPI.COMM_SELF)
    assert check_dataset(folder) == []
    assert {p.name: p.stat().st_mtime_ns for p in folder.glob("shard-*.h5")} == before
    assert_same(serial, folder)


def test_an_older_dataset_without_stiffness_is_left_alone(
    case: Case, serial: Path, tmp_path: Path
) -> None:
    folder = shutil.copytree(serial, tmp_path / "nodal")
    (folder / STIFFNESS_FILE).unlink()
    older = write_manifest(folder, read_manifest(folder).model_copy(update={"stiffness": None}))
    assert run(case, folder, comm=MPI.COMM_SELF) == older
    assert not (folder / STIFFNESS_FILE).exists()
    assert check_dataset(folder) == []


@pytest.mark.faults
def test_killed_between_stiffness_and_manifest(
    case: Case, serial: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "nodal"

    def kill(*_: Any) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr("datagen.farm.farm.write_manifest", kill)
        with pytest.raises(KeyboardInterrupt):
            run(case, folder, comm=MPI.COMM_SELF)
    assert (folder / STIFFNESS_FILE).is_file()
    before = {p.name: p.stat().st_mtime_ns for p in folder.glob("shard-*.h5")}
    run(case, folder, comm=MPI.COMM_SELF)
    assert check_dataset(folder) == []
    assert {p.name: p.stat().st_mtime_ns for p in folder.glob("shard-*.h5")} == before
    assert_same(serial, folder)


def test_another_case_is_refused(case: Case, serial: Path) -> None:
    stiffer = case.materials[0].model_copy(update={"young_modulus": 600.0})
    with pytest.raises(InputError, match=r"material.young_modulus = 600.0, the folder has 500.0"):
        run(case.model_copy(update={"material": stiffer}), serial, comm=MPI.COMM_SELF)
    assert check_dataset(serial) == []


def test_a_second_run_is_refused(
    case: Case, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("shared_schema.common.folder_lock.WAIT", 0.1)
    folder = tmp_path / "nodal"
    first = Journal(folder, case, "datagen run")
    first.open()
    with pytest.raises(InputError, match="another run is working"):
        run(case, folder, comm=MPI.COMM_SELF)
    first.close()
    run(case, folder, comm=MPI.COMM_SELF)
    assert check_dataset(folder) == []


def test_a_folder_of_something_else_is_refused(case: Case, tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").write_text("")
    with pytest.raises(InputError, match="holds something else"):
        run(case, tmp_path, comm=MPI.COMM_SELF)
    assert [p.name for p in tmp_path.iterdir()] == ["thesis.tex"]


@pytest.mark.mpi
@pytest.mark.parametrize("ranks", [0, pytest.param(2, marks=pytest.mark.slow)])
def test_nothing_solved_is_a_failure(tmp_path: Path, ranks: int) -> None:
    """Loads of up to 1 MN have no equilibrium that can be found: none is dropped in silence.

    Exit code 1 and one line, on many ranks as on one; the dataset is there.
    """
    path = write_case(tmp_path, samples=4, shard_size=2, range=[-1e6, 1e6])
    out = tmp_path / "nodal"
    result = execute(ranks, path, out)
    said = (
        f"datagen: failed: {out}: none of the 4 load cases has an equilibrium; "
        "`datagen info` counts the reasons"
    )
    assert (result.returncode, without_launcher(result.stderr).splitlines()[-1]) == (1, said)
    assert result.stderr.count("failed:") == 1
    manifest = read_manifest(out)
    assert (manifest.samples, manifest.failed) == (0, 4)
    assert check_dataset(out) == []
    shard = read_shard(out / "shard-00000.h5", "nodal")
    assert shard["failed/number"].tolist() == [0, 1]
    assert all(shard["failed/reason"])
    assert np.all(shard["failed/load_factor"] < 1)
    assert np.abs(shard["failed/force"]).max() > 1e5
    assert len(shard["samples/number"]) == 0


def whole(shards: int) -> dict[int, range]:
    return {k: range(k * SIZE, (k + 1) * SIZE) for k in range(shards)}


def idle_time(pieces: list[Piece], groups: int, times: np.ndarray) -> float:
    """Time between the end of a group's last piece and the end of all, summed over the groups."""
    ends = [0.0] * groups
    for piece in pieces:
        heapq.heapreplace(ends, ends[0] + float(times[list(piece.numbers)].sum()))
    return sum(max(ends) - end for end in ends)


@pytest.mark.parametrize(("shards", "groups"), [(710, 2), (710, 64), (4, 2), (3, 8), (1, 100)])
def test_every_sample_is_in_one_piece(shards: int, groups: int) -> None:
    pieces = plan(whole(shards), groups)
    assert [n for piece in pieces for n in piece.numbers] == list(range(shards * SIZE))
    for shard in range(shards):
        assert {p.of for p in pieces if p.shard == shard} == {sum(p.shard == shard for p in pieces)}


def test_one_group_gets_whole_shards() -> None:
    assert [piece.of for piece in plan(whole(5), 1)] == [1] * 5


def test_only_unsolved_samples_are_in_pieces() -> None:
    """A shard with two unsolved samples, and one that is solved but not yet merged."""
    pieces = plan({3: [151, 190], 7: []}, 2)
    assert [piece.numbers for piece in pieces] == [(151,), (190,), ()]
    assert [piece.of for piece in pieces] == [2, 2, 1]


@pytest.mark.parametrize("groups", [2, 16, 64, 128])
def test_all_groups_end_together(groups: int) -> None:
    """710 shards, solve times with a standard deviation of 30 %.

    The idle time is below 2 % of the work, and at most a fifth of that with whole shards only.
    """
    generator = np.random.default_rng(0)
    times = generator.lognormal(sigma=0.3, size=710 * SIZE)
    ours = idle_time(plan(whole(710), groups), groups, times)
    coarse = [Piece(k, tuple(numbers), 1) for k, numbers in whole(710).items()]
    assert ours < 0.02 * times.sum()
    assert ours <= 0.2 * idle_time(coarse, groups, times)
    longest = max(times[list(p.numbers)].sum() for p in plan(whole(710), groups) if p.of > 1)
    assert ours <= groups * longest
