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
    """Refuse a file in a folder if it is a link, lies behind one, or is larger than the memory.

    The folder itself may be a link. A file that does not exist passes.

    Raises
    ------
    InputError
        If a component of the path below the folder is a symbolic link, or the file cannot be read
        whole.
    """
    below = path.relative_to(folder)
    for count in range(1, len(below.parts) + 1):
        link = folder.joinpath(*below.parts[:count])
        if link.is_symlink():
            raise InputError(f"{link}: a symbolic link, expected the file itself")
    if path.is_file():
        require_memory(path.stat().st_size, f"{path}: the file")
