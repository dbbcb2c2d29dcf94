"""Locks of folders: one owner, on file systems with and without locks; dead owners do not stay."""

from __future__ import annotations

import errno
import multiprocessing
import os
import signal
import subprocess
import sys
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import pytest

from shared_schema.common import folder_lock
from shared_schema.common.errors import InputError
from shared_schema.common.folder_lock import LOCK, FolderLock

pytestmark = pytest.mark.faults

HOLD = """
import sys, time
from pathlib import Path
from shared_schema.common import folder_lock
folder_lock.BEAT = 0.1
if sys.argv[2] == "elsewhere":
    folder_lock._boot = lambda: "another-machine"
with folder_lock.FolderLock(Path(sys.argv[1])):
    print("held", flush=True)
    sys.stdin.read()
"""


def start_holder(folder: Path, where: str = "here") -> subprocess.Popen[str]:
    process = subprocess.Popen(
        [sys.executable, "-c", HOLD, str(folder), where],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "held\n"
    return process


@pytest.fixture(autouse=True)
def _impatient(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(folder_lock, "WAIT", 0.3)
    monkeypatch.setattr(folder_lock, "DEAD_AFTER", 60.0)  # a living owner's heart beats sooner


def kill(process: subprocess.Popen[str], monkeypatch: pytest.MonkeyPatch) -> None:
    """End an owner, of whose death others need not be sure for long."""
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    monkeypatch.setattr(folder_lock, "DEAD_AFTER", 0.3)


@pytest.fixture
def _no_flock(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: Any) -> None:
        raise OSError(errno.ENOSYS, "Function not implemented")

    monkeypatch.setattr("fcntl.flock", refuse)


def test_a_second_owner_is_refused_and_told_who_works(tmp_path: Path) -> None:
    folder = tmp_path / "a" / "b"
    with FolderLock(folder), pytest.raises(InputError) as refused, FolderLock(folder, "--to"):
        pass
    assert str(refused.value).startswith(f"--to '{folder}': another run is working in it (process")
    assert f"process {os.getpid()} on" in str(refused.value)
    assert list(folder.iterdir()) == []
    with FolderLock(folder):
        assert [path.name for path in folder.iterdir()] == [LOCK]


@pytest.mark.parametrize("where", ["here", "elsewhere"])
def test_another_process(tmp_path: Path, where: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Refused while it lives; after SIGKILL its lock is taken over, also that of a machine away."""
    with start_holder(tmp_path, where) as process:
        with pytest.raises(InputError, match=f"process {process.pid} on"), FolderLock(tmp_path):
            pass
        kill(process, monkeypatch)
        assert (tmp_path / LOCK).exists()
        with FolderLock(tmp_path):
            pass


def test_locks_that_other_machines_do_not_see(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As on BeeGFS: the system's lock is free, but the owner's heart beats elsewhere."""
    with start_holder(tmp_path, "elsewhere") as process:
        monkeypatch.setattr("fcntl.flock", lambda *_: None)
        with pytest.raises(InputError, match="another run"), FolderLock(tmp_path):
            pass
        process.communicate()


@pytest.mark.usefixtures("_no_flock")
def test_a_file_system_without_locks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with start_holder(tmp_path) as process:
        with pytest.raises(InputError, match="another run"), FolderLock(tmp_path):
            pass
        kill(process, monkeypatch)
    with FolderLock(tmp_path):
        pass
    assert list(tmp_path.iterdir()) == []


def test_a_lock_that_was_killed_before_it_had_a_name(tmp_path: Path) -> None:
    (tmp_path / LOCK).touch()
    with FolderLock(tmp_path):
        assert str(os.getpid()) in (tmp_path / LOCK).read_text()


def count_up(folder: Path) -> int:
    """Add 1 to a number in a file, which is lost if two do it at once; count the refusals."""
    number = folder / "number"
    for refused in range(1000):
        try:
            with FolderLock(folder):
                number.write_text(str(int(number.read_text()) + 1))
                return refused
        except InputError:
            pass
    raise AssertionError


def test_many_processes_at_once(tmp_path: Path) -> None:
    (tmp_path / "number").write_text("0")
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(4, mp_context=context) as pool:
        assert all(count >= 0 for count in pool.map(count_up, [tmp_path] * 40))
    assert (tmp_path / "number").read_text() == "40"
