"""Files that appear complete or not at all."""

from __future__ import annotations

import errno
import os
import stat
from contextlib import nullcontext
from pathlib import Path

import pytest

from shared_schema.common.errors import InputError
from shared_schema.common.files import (
    PARTIAL,
    complete_or_absent,
    remove_partial_files,
    require_writable,
    write_text,
)


def test_file_and_folder_are_synchronised(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The content before it takes its name, the folder once it has it."""
    path = tmp_path / "a.txt"
    seen = []

    def record(descriptor: int) -> None:
        seen.append((stat.S_ISDIR(os.fstat(descriptor).st_mode), path.exists()))

    monkeypatch.setattr(os, "fsync", record)
    write_text(path, "content")
    assert seen == [(False, False), (True, True)]
    assert path.read_text() == "content"


@pytest.mark.parametrize(("number", "is_error"), [(errno.EINVAL, False), (errno.EIO, True)])
def test_folders_that_cannot_be_synchronised(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, number: int, is_error: bool
) -> None:
    """EINVAL is what a file system says that knows no such thing."""

    def refuse(descriptor: int) -> None:
        if stat.S_ISDIR(os.fstat(descriptor).st_mode):
            raise OSError(number, os.strerror(number))

    monkeypatch.setattr(os, "fsync", refuse)
    with pytest.raises(OSError, match=os.strerror(number)) if is_error else nullcontext():
        write_text(tmp_path / "a.txt", "content")
    assert [path.name for path in tmp_path.iterdir()] == ["a.txt"]


def break_off(path: Path, error: BaseException) -> None:
    with complete_or_absent(path) as partial:
        partial.write_text("half")
        raise error


@pytest.mark.parametrize("named", [False, True])
def test_a_full_disk_names_the_file(tmp_path: Path, named: bool) -> None:
    """Neither an error without a name nor one with the partial file's means much to a user."""
    path = tmp_path / "a.txt"
    path.write_text("old")
    names = [str(tmp_path / f"{PARTIAL}{os.getpid()}-a.txt")] if named else []
    with pytest.raises(OSError, match="No space") as error:
        break_off(path, OSError(errno.ENOSPC, "No space left on device", *names))
    assert str(error.value) == f"[Errno 28] No space left on device: '{path}'"
    assert list(tmp_path.iterdir()) == [path]
    assert path.read_text() == "old"


@pytest.mark.parametrize(
    "raised", [OSError("text"), OSError(errno.EIO, "text", "elsewhere"), KeyboardInterrupt()]
)
def test_other_errors_are_left_as_they_are(tmp_path: Path, raised: BaseException) -> None:
    with pytest.raises(type(raised)) as error:
        break_off(tmp_path / "a.txt", raised)
    assert error.value is raised
    assert list(tmp_path.iterdir()) == []


def test_partial_files_are_removed(tmp_path: Path) -> None:
    for name in ("a.txt", f"{PARTIAL}12-a.txt", f"{PARTIAL}13-b.txt"):
        (tmp_path / name).touch()
    remove_partial_files(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["a.txt"]


def test_what_can_be_written(tmp_path: Path) -> None:
    """A folder, a file in it, and what is below folders that do not exist yet."""
    (tmp_path / "file").write_text("content")
    before = tmp_path.stat().st_mtime_ns
    for out in ("", "file", "new", "new/a/b"):
        require_writable(tmp_path / out)
    assert [path.name for path in tmp_path.iterdir()] == ["file"]
    assert tmp_path.stat().st_mtime_ns == before
    assert (tmp_path / "file").read_text() == "content"


@pytest.mark.parametrize(
    ("out", "reason"),
    [("file/new", "Not a directory"), (f"{'a' * 300}/new", "File name too long")],
)
def test_what_cannot_be_written(tmp_path: Path, out: str, reason: str) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(InputError) as error:
        require_writable(tmp_path / out)
    assert str(error.value) == f"--out '{tmp_path / out}': cannot be written to ({reason})"
