"""Faults of all kinds: the same command resumes the run and makes the same dataset."""

from __future__ import annotations

import os
import re
import shutil
import signal
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from mpi4py import MPI

from datagen.cases.case import Case, read_case
from datagen.farm.farm import run
from datagen.farm.shard_job import ShardJob
from datagen.transforms.reindexing import structure
from shared_schema.checker import check_dataset
from shared_schema.common.errors import InputError, StoppedError
from shared_schema.samples.journal import Journal
from tests.datagen.farm_runs import (
    all_end,
    assert_same,
    command,
    finish,
    held,
    pids_of,
    recorded,
    start,
    wait_until,
    write_case,
)
from tests.datagen.refusal import refusal
from tools.open_mpi import without_launcher
from tools.small_disk import SmallDisk

pytestmark = pytest.mark.faults

DiskMaker = Callable[[str], SmallDisk]


@pytest.fixture(scope="module")
def case_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """30 shards of 45 KiB."""
    return write_case(tmp_path_factory.mktemp("case"), samples=600, shard_size=20)


@pytest.fixture(scope="module")
def whole(case_file: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The dataset of an uninterrupted run."""
    folder = tmp_path_factory.mktemp("whole") / "nodal"
    run(read_case(str(case_file)), folder, comm=MPI.COMM_SELF)
    return folder


@pytest.fixture
def make_disk(tmp_path: Path) -> Iterator[DiskMaker]:
    disks = []

    def make(options: str) -> SmallDisk:
        disks.append(SmallDisk(tmp_path / "disk", options))
        return disks[-1]

    yield make
    for disk in disks:
        disk.close()


def bound_by_permissions() -> list[str]:
    """Words before a command that make file permissions bind it, even if the user is root."""
    bound = ["setpriv", "--bounding-set=-all"] if os.getuid() == 0 else []
    if bound and finish([*bound, "true"]).returncode:
        pytest.skip("root cannot drop its capabilities here")
    return bound


def finished(folder: Path) -> dict[str, int]:
    """Shards that count, each of which is intact, and when they were written."""
    names = Journal(folder, read_case("beam2d"), "datagen run").entries()
    assert len(names) == recorded(folder)
    return {name: (folder / name).stat().st_mtime_ns for name in names}


def assert_completed(folder: Path, whole: Path, kept: dict[str, int]) -> None:
    """The dataset of an uninterrupted run, in which nothing finished was done again."""
    assert check_dataset(folder) == []
    assert_same(whole, folder)
    assert {name: (folder / name).stat().st_mtime_ns for name in kept} == kept
    assert not list(folder.rglob(".*"))


# --- disks --------------------------------------------------------------------------------------


@pytest.mark.mpi
@pytest.mark.slow
def test_a_full_disk(make_disk: DiskMaker, case_file: Path, whole: Path) -> None:
    """1 MiB holds 22 shards at most; in 16 MiB the same command ends what was begun."""
    disk = make_disk("size=1m")
    out, seen = disk.folder / "nodal", disk.seen / "nodal"
    failed = finish(disk.words(command(2, case_file, out)))
    assert failed.returncode == 1
    said = rf"datagen: failed: \[Errno 28\] No space left on device: '{re.escape(str(out))}/.+'\n"
    assert re.fullmatch(said, without_launcher(failed.stderr)), failed.stderr
    assert not list(seen.rglob(".partial-*"))
    kept = finished(seen)
    assert 10 <= len(kept) <= 22
    disk.remount("size=16m")
    assert finish(disk.words(command(2, case_file, out))).returncode == 0
    assert_completed(seen, whole, kept)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("files", "named", "done"),
    [
        (3, ".journal/case.json", 0),
        (7, ".journal/shard-00001.json", 1),
        (65, "manifest.json", 30),
    ],
)
def test_a_disk_without_room_for_one_more_file(
    make_disk: DiskMaker, case_file: Path, whole: Path, files: int, named: str, done: int
) -> None:
    """Two folders, lock, case, two files a shard, and the stiffness: 4 + 2 · 30 + 1 = 65."""
    disk = make_disk(f"nr_inodes={files + 1}")  # and the disk's own folder
    out, seen = disk.folder / "nodal", disk.seen / "nodal"
    failed = finish(disk.words(command(0, case_file, out)))
    assert failed.returncode == 1
    assert failed.stderr.endswith(
        f"datagen: failed: [Errno 28] No space left on device: '{out / named}'\n"
    )
    assert "Traceback" not in failed.stderr
    assert not list(seen.rglob(".partial-*"))
    kept = finished(seen)
    assert len(kept) == done
    disk.remount("nr_inodes=100")
    run(read_case(str(case_file)), seen, comm=MPI.COMM_SELF)
    assert_completed(seen, whole, kept)


@pytest.mark.mpi
@pytest.mark.slow
@pytest.mark.parametrize("ranks", [0, 2])
def test_a_read_only_disk(make_disk: DiskMaker, case_file: Path, whole: Path, ranks: int) -> None:
    """One line and exit code 2 of every command that writes, and nothing is written."""
    disk = make_disk("ro,size=16m")
    every: list[list[str | Path]] = [
        ["run", case_file, "--out", "a/b/nodal"],
        ["run", case_file, "--out", "."],
        ["structure", whole, "--out", "grid"],
        ["noise", whole, "--out", "noisy"],
        ["solve", case_file, "--load", "4,1:0,-1", "--out", "u.npz"],
        ["plot", whole, "--out", "a.png"],
        ["export", whole, "--out", "a.xdmf"],
        ["info", whole, "--figure", "a.png"],
    ]
    lines = [[*map(str, words[:-1]), str(disk.folder / words[-1])] for words in every]
    lines = lines[:1] if ranks else lines
    program = "import sys; from datagen.command_line import main; "
    program += f"sys.exit(sum(main(line) != 2 for line in {lines!r}))"
    launcher = ["mpirun", "-n", str(ranks)] if ranks else []
    result = finish(disk.words([*launcher, sys.executable, "-c", program]))
    said = [
        f"datagen: error: {option} '{out}': cannot be written to (Read-only file system)"
        for *_, option, out in lines
    ]
    assert (result.returncode, without_launcher(result.stderr).splitlines()) == (0, said)
    assert list(disk.seen.iterdir()) == []


def test_a_folder_without_permission(case_file: Path, tmp_path: Path) -> None:
    bound = bound_by_permissions()
    tmp_path.chmod(0o555)
    out = tmp_path / "nodal"
    result = finish([*bound, *command(0, case_file, out)])
    said = f"datagen: error: --out '{out}': cannot be written to (Permission denied)\n"
    assert (result.returncode, result.stderr) == (2, said)
    assert list(tmp_path.iterdir()) == []


def test_nothing_is_built_for_a_folder_that_cannot_be_made(
    case_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").touch()
    monkeypatch.setattr("datagen.farm.farm.make_body", pytest.fail)
    with pytest.raises(InputError, match=r"file/nodal': cannot be written to \(Not a directory\)"):
        run(read_case(str(case_file)), tmp_path / "file" / "nodal", comm=MPI.COMM_SELF)


@pytest.mark.mpi
@pytest.mark.slow
def test_a_folder_that_becomes_read_only(case_file: Path, whole: Path, tmp_path: Path) -> None:
    out, gate = tmp_path / "nodal", tmp_path / "gate"
    folders = out / ".journal", out
    held_run = held(command(2, case_file, out), gate)
    with start([*bound_by_permissions(), *held_run]) as process:
        wait_until(lambda: recorded(out) >= 5, process)
        for folder in folders:
            folder.chmod(0o555)
        gate.unlink()
        _, said = process.communicate(timeout=120)
    assert process.returncode == 1
    line = rf"datagen: failed: \[Errno 13\] Permission denied: '{re.escape(str(out))}/.+'\n"
    assert re.fullmatch(line, without_launcher(said)), said
    for folder in folders:
        folder.chmod(0o755)
    kept = finished(out)
    run(read_case(str(case_file)), out, comm=MPI.COMM_SELF)
    assert_completed(out, whole, kept)


# --- processes ----------------------------------------------------------------------------------


@pytest.mark.mpi
@pytest.mark.slow
@pytest.mark.parametrize(
    ("victim", "number"),
    [
        (0, signal.SIGKILL),
        (1, signal.SIGKILL),
        (None, signal.SIGINT),  # mpirun itself, as by Ctrl-C
        (None, signal.SIGTERM),
    ],
)
def test_a_signal_to_one_process(
    case_file: Path, whole: Path, tmp_path: Path, victim: int | None, number: signal.Signals
) -> None:
    """mpirun ends the others; only what was under way is done again."""
    out = tmp_path / "nodal"
    with start(held(command(2, case_file, out), tmp_path / "gate")) as process:
        wait_until(lambda: recorded(out) >= 5, process)
        os.kill(process.pid if victim is None else pids_of(out)[victim], number)
        _, said = process.communicate(timeout=120)
    assert process.returncode != 0
    assert "Traceback" not in said
    assert all_end(out, within=60)  # mpirun may end before its last process does
    kept = finished(out)
    assert 5 <= len(kept) < 30
    run(read_case(str(case_file)), out, comm=MPI.COMM_SELF)
    assert_completed(out, whole, kept)


@pytest.mark.slow
def test_a_killed_structure_step(whole: Path, tmp_path: Path) -> None:
    """Killed when the first shard is written but not yet named."""
    out = tmp_path / "grid"
    killed = f"""
import os, pathlib
os.fsync = lambda _: os.kill(os.getpid(), 9)
from datagen.transforms.reindexing import structure
structure(pathlib.Path({str(whole)!r}), pathlib.Path({str(out)!r}))
"""
    assert finish([sys.executable, "-c", killed]).returncode == -signal.SIGKILL
    assert sorted(path.name[:9] for path in out.iterdir()) == [".lock", ".partial-"]
    assert structure(whole, out).samples == 600
    assert check_dataset(out) == []
    assert not list(out.glob(".*"))


# --- journals -----------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def case(tmp_path_factory: pytest.TempPathFactory) -> Case:
    return read_case(str(write_case(tmp_path_factory.mktemp("small"), samples=150, shard_size=30)))


@pytest.fixture(scope="module")
def small(case: Case, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("small") / "nodal"
    run(case, folder, comm=MPI.COMM_SELF)
    return folder


@pytest.fixture(scope="module")
def stopped(case: Case, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run that got SIGTERM in the fourth shard: three shards and a part are kept."""
    folder = tmp_path_factory.mktemp("stopped") / "nodal"
    solve_next = ShardJob.solve_next

    def solve_and_stop(job: ShardJob) -> bool:
        if job.numbers[job.done] == 100:
            signal.raise_signal(signal.SIGTERM)
        return solve_next(job)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(ShardJob, "solve_next", solve_and_stop)
        with pytest.raises(StoppedError):
            run(case, folder, comm=MPI.COMM_SELF)
    assert sorted(path.name for path in (folder / ".journal").iterdir()) == [
        "case.json",
        "part-00003-00000090.h5",
        "part-00003-00000090.sha256",
        *(f"shard-0000{shard}.json" for shard in range(3)),
    ]
    return folder


def test_it_is_called_unfinished(stopped: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Three of five shards, as the fixture says; all commands that read a dataset refuse it."""
    before = sorted(stopped.rglob("*"))
    text = f"{stopped}: unfinished, 3 of 5 shards; run the same `datagen run … --out {stopped}`"
    out = str(stopped.parent / "structured")
    for arguments in (["check"], ["info"], ["structure", "--out", out]):
        assert text in refusal([*arguments, str(stopped)], capsys)
    assert sorted(stopped.rglob("*")) == before


@pytest.mark.slow
@pytest.mark.parametrize("content", [None, b"half", b"[1]", b"\xff\xfe\x00"])
@pytest.mark.parametrize(
    "name",
    ["case.json", "shard-00001.json", "part-00003-00000090.h5", "part-00003-00000090.sha256"],
)
def test_a_damaged_journal(
    case: Case, small: Path, stopped: Path, tmp_path: Path, name: str, content: bytes | None
) -> None:
    """A shard that cannot be read (None: missing, half: cut in the middle) is not finished."""
    folder = shutil.copytree(stopped, tmp_path / "nodal")
    damaged = folder / ".journal" / name
    if content == b"half":
        content = damaged.read_bytes()[: damaged.stat().st_size // 2]
    damaged.unlink()
    if content is not None:
        damaged.write_bytes(content)
    kept = {path: path.stat().st_mtime_ns for path in folder.glob("*.h5") if path.stem not in name}
    run(case, folder, comm=MPI.COMM_SELF)
    assert len(kept) == (2 if name == "shard-00001.json" else 3)
    assert_completed(folder, small, {path.name: time for path, time in kept.items()})


@pytest.mark.parametrize("kept", ["shard-00000.h5", "part-00003-00000090.h5"])
def test_another_case_is_refused_even_if_the_journal_does_not_say_which(
    case: Case, stopped: Path, tmp_path: Path, kept: str
) -> None:
    """Every shard and every part knows the case that it is of."""
    folder = shutil.copytree(stopped, tmp_path / "nodal")
    (folder / ".journal" / "case.json").write_text("")
    if kept.startswith("part"):
        for path in folder.rglob("shard-*"):
            path.unlink()
    before = {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    other = case.model_copy(
        update={"material": case.materials[0].model_copy(update={"young_modulus": 600.0})}
    )
    with pytest.raises(InputError, match=f"{kept} is made from another case"):
        run(other, folder, comm=MPI.COMM_SELF)
    assert {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()} == before
