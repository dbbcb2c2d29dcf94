"""Write files that appear complete or not at all; check first that a path can be written to."""

from __future__ import annotations

import errno
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from shared_schema.common.errors import InputError

PARTIAL = ".partial-"
REFUSALS = (errno.EROFS, errno.EACCES, errno.EPERM, errno.ENOTDIR, errno.ENAMETOOLONG)


@contextmanager
def complete_or_absent(path: Path) -> Iterator[Path]:
    """Yield a path to write to; on success move the file, synchronised, to its name.

    File and folder are synchronised with the disk, so that a power cut afterwards loses nothing.

    Parameters
    ----------
    path : Path
        Final name of the file.

    Yields
    ------
    Path
        Path to write to, in the same folder and with the same ending.

    Raises
    ------
    OSError
        If it cannot be written (a full disk, say); it names `path`, and nothing is left behind.
    """
    partial = path.with_name(f"{PARTIAL}{os.getpid()}-{path.name}")
    try:
        yield partial
        with partial.open("rb+") as written:
            os.fsync(written.fileno())
        partial.replace(path)
    except OSError as error:
        if error.errno is None or error.filename not in (None, str(partial)):
            raise
        raise OSError(error.errno, error.strerror, str(path)) from error
    finally:
        with suppress(OSError):  # not there, or as unwritable as it was in writing
            partial.unlink()
    _synchronise(path.parent)


def _synchronise(folder: Path) -> None:
    """Synchronise a folder with the disk, if the file system supports it."""
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    except OSError as error:
        if error.errno != errno.EINVAL:
            raise
    finally:
        os.close(descriptor)


def write_text(path: Path, text: str) -> None:
    """Write a text file that appears complete, or not at all."""
    with complete_or_absent(path) as partial:
        partial.write_text(text, encoding="utf-8")


def remove_partial_files(folder: Path) -> None:
    """Remove the partial files that killed processes left in a folder."""
    for partial in folder.glob(f"{PARTIAL}*"):
        partial.unlink(missing_ok=True)


def require_writable(out: Path, option: str = "--out") -> None:
    """Raise InputError unless a file or folder `out` can be created.

    Creates and removes an unnamed file in the folder, or in the nearest existing one above it.

    Raises
    ------
    InputError
        If permissions or a read-only file system forbid it.
    """
    try:
        folder = out if out.is_dir() else out.parent
        while not _is_there(folder):
            folder = folder.parent
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        if error.errno not in REFUSALS:
            raise
        raise InputError(f"{option} '{out}': cannot be written to ({error.strerror})") from None


def _is_there(path: Path) -> bool:
    """As `Path.exists`, which from Python 3.14 on is also False for paths that cannot be."""
    try:
        path.stat()
    except FileNotFoundError:
        return False
    return True
