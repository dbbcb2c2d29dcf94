"""``metrics.jsonl``: one line per epoch, each with a checksum of its own; lines are only appended.

A line that a crash cut short has no end; it is left out. Any other line that is not as it was
written is damage, and so is a missing line between two others.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from shared_schema.common.errors import InputError
from shared_schema.common.files import write_text
from shared_schema.manifest import digest_of

CHECK = "check"
CHECK_LENGTH = 16  # hexadecimal digits
Line = dict[str, Any]


def spelled(line: Mapping[str, Any]) -> str:
    """Text of a line, with its checksum as the last entry."""
    return json.dumps({**line, CHECK: digest_of(dict(line))[:CHECK_LENGTH]}) + "\n"


def append_line(path: Path, line: Mapping[str, Any]) -> None:
    """Append a line, synchronised with the disk; an OSError names the file."""
    try:
        with path.open("a", encoding="ascii") as file:
            file.write(spelled(line))
            file.flush()
            os.fsync(file.fileno())
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(path)) from error


def write_lines(path: Path, lines: Iterable[Mapping[str, Any]]) -> None:
    """Write a file of lines; it appears complete or not at all."""
    write_text(path, "".join(spelled(line) for line in lines))


def read_lines(path: Path, checked: bool) -> list[Line]:
    """Read all complete lines, without their checksums.

    Parameters
    ----------
    path : Path
    checked : bool
        Every line must have a checksum; lines of earlier versions have none.

    Raises
    ------
    InputError
        If a line is damaged, has no checksum, or is not of the epoch after that of the line before;
        the first epoch is 1, or 0 for a model that is fitted directly.
    """
    if not path.is_file():
        return []
    lines: list[Line] = []
    for number, text in enumerate(path.read_bytes().split(b"\n")[:-1], start=1):
        if not text and not checked:  # files of earlier versions may have been edited
            continue
        line = _line(text, checked)
        if line is None:
            raise InputError(f"{path}: line {number} is damaged")
        expected = lines[-1]["epoch"] + 1 if lines else min(line["epoch"], 1)
        if line["epoch"] != expected:
            raise InputError(
                f"{path}: line {number} is of epoch {line['epoch']}, expected {expected}"
            )
        lines.append(line)
    return lines


def _line(text: bytes, checked: bool) -> Line | None:
    """Content of a line; None if it is damaged."""
    try:
        line = json.loads(text)
    except (ValueError, RecursionError):
        return None
    if not isinstance(line, dict):
        return None
    is_checked = line.pop(CHECK, None) is not None
    if (checked or is_checked) and spelled(line).encode() != text + b"\n":
        return None
    return line if _is_measured(line) else None


def _is_measured(line: Line) -> bool:
    """True if a line has an epoch and, if any, numbers only."""
    epoch, seconds = line.get("epoch"), line.get("seconds", 0.0)
    return (
        all(isinstance(v, int | float) and not isinstance(v, bool) for v in line.values())
        and isinstance(epoch, int)
        and epoch >= 0
        and math.isfinite(seconds)
    )
