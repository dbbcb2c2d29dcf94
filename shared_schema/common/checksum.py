"""Checksums of files, and files that are not even looked into: links, and huge ones."""

from __future__ import annotations

import hashlib
from pathlib import Path

from shared_schema.common.errors import InputError
from shared_schema.common.memory import require_memory


def sha256(path: Path) -> str:
    """SHA-256 of a file, in hexadecimal."""
    digest = hashlib.sha256()
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
