"""Files that appear complete or not at all, checksums, and files that are not even looked into."""

from __future__ import annotations

import errno
import hashlib
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from shared_schema.common.errors import InputError
from shared_schema.common.machine import require_memory

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
    """Synchronise a folder with the disk, if the system and the file system support it."""
    if os.name == "nt":
        return
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


def sha256(*paths: Path) -> str:
    """SHA-256 of a file, or of several one after the other, in hexadecimal."""
    digest = hashlib.sha256()
    for path in paths:
        with path.open("rb") as file:
            while block := file.read(1 << 20):
                digest.update(block)
    return digest.hexdigest()


def require_plain(folder: Path, path: Path) -> None:
    """Refuse a file of a folder if it is outside, a link, behind one, or larger than the memory.

    The folder itself may be a link. A file that does not exist passes.

    Raises
    ------
    InputError
        If the path leads out of the folder, a component below it is a symbolic link, or the file is
        larger than the memory.
    """
    require_inside(folder, path)
    below = path.relative_to(folder)
    for count in range(1, len(below.parts) + 1):
        link = folder.joinpath(*below.parts[:count])
        if link.is_symlink():
            raise InputError(f"{link}: a symbolic link, expected the file itself")
    if path.is_file():
        require_memory(path.stat().st_size, f"{path}: the file")


def require_inside(folder: Path, path: Path) -> None:
    """Raise InputError if a path, which begins with a folder's, leads out of it; links aside."""
    if not path.is_relative_to(folder) or ".." in path.relative_to(folder).parts:
        raise InputError(f"{path}: outside of {folder}, expected a file in it")


LARGEST = 1 << 26  # bytes


def text_lines(path: Path, option: str) -> list[str]:
    """Lines of a UTF-8 file.

    Raises
    ------
    InputError
        That names option and file, if it is too large or cannot be read.
    """
    try:
        if path.stat().st_size > LARGEST:
            raise InputError(f"{option} '{path}': expected at most {LARGEST} bytes")
        return path.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{option} '{path}': cannot be read ({error})") from None
