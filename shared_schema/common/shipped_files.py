"""YAML files that come with a program: found by name from any folder, listed with one line each."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from shared_schema.common.configuration import read_yaml

PARENTHESES = re.compile(r"\s*\([^)]*\)")
END_OF_LINE = re.compile(r"[:;](?=\s)|\.(?=\s|$)")


def shipped_files(folder: Path) -> Iterator[tuple[str, dict[str, Any], str]]:
    """Yield name, content and one line of every YAML file of a folder, sorted by name."""
    for path in sorted(folder.glob("*.yaml")):
        yield path.stem, read_yaml(path), one_line(path.read_text(encoding="utf-8"))


def names_in(folder: Path) -> list[str]:
    """Return the names of the YAML files of a folder, sorted."""
    return sorted(path.stem for path in folder.glob("*.yaml"))


def one_line(text: str) -> str:
    """Return the beginning of the comment at the head of a YAML file, without parentheses.

    It ends before the first full stop, colon or semicolon.
    """
    lines = []
    for line in text.splitlines():
        if not line.startswith("#"):
            break
        lines.append(line.lstrip("# "))
    comment = PARENTHESES.sub("", " ".join(lines))
    end = END_OF_LINE.search(comment)
    return comment[: end.start()] if end else comment
