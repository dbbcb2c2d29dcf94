"""Rows of a long measurement, one a line of a file, so that the same command goes on."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from shared_schema.common import Parser

Row = dict[str, Any]
__all__ = ["add_rows_option", "kept_rows"]


def add_rows_option(parser: Parser) -> None:
    """Add the option that names the file."""
    said = "where finished loads are kept, so that the same command goes on"
    parser.add_argument("--rows", type=Path, metavar="FILE.jsonl", help=said)


def kept_rows(
    path: Path | None, name: str, seed: int, count: int, make: Callable[[int], Row]
) -> list[Row]:
    """Rows 0 to count - 1 of one name and seed: those of the file, and others made and appended.

    Parameters
    ----------
    path : Path or None
        File of lines of JSON; None keeps nothing.
    make : callable
        Makes the row of a number, of values that JSON knows.
    """
    found: dict[int, Row] = {}
    if path is not None and path.is_file():
        rows = map(json.loads, path.read_text().splitlines())
        found = {row["number"]: row for row in rows if (row["name"], row["seed"]) == (name, seed)}
    for number in range(count):
        if number in found:
            continue
        found[number] = {"name": name, "seed": seed, "number": number, **make(number)}
        if path is not None:
            with path.open("a") as file:
                file.write(json.dumps(found[number]) + "\n")
    return [found[number] for number in range(count)]
