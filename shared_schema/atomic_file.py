"""Files that appear complete under their name, or not at all."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

PARTIAL = ".partial-"


@contextmanager
def complete_or_absent(path: Path) -> Iterator[Path]:
    """Write to the path that is given; it takes its name, on the disk, when all went well.

    Parameters
    ----------
    path : Path
        Name that the file shall have.

    Yields
    ------
    Path
        Where to write, beside it and with the same ending.
    """
    partial = path.with_name(f"{PARTIAL}{os.getpid()}-{path.name}")
    try:
        yield partial
        with partial.open("rb+") as written:
            os.fsync(written.fileno())
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)


def write_text(path: Path, text: str) -> None:
    """Write a text file that appears complete, or not at all."""
    with complete_or_absent(path) as partial:
        partial.write_text(text, encoding="utf-8")


def remove_partial_files(folder: Path) -> None:
    """Remove what killed processes left behind in a folder."""
    for partial in folder.glob(f"{PARTIAL}*"):
        partial.unlink(missing_ok=True)
