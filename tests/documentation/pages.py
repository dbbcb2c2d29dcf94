"""The pages of the documentation, and which of them have code blocks to run."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from tests.documentation.page import Block, blocks_of
from tests.end_to_end.commands import ROOT

ELSEWHERE = (
    "CONTRIBUTING.md",
    "README.md",
    "SECURITY.md",
    "docker/README.md",
    "shared_schema/README.md",
)
SHORT = (ROOT / "README.md", ROOT / "docs" / "get-started.md")
MADE = ("-commands.md", "-keys.md")  # by `make docs`, from the programs
PAGES = sorted(
    [
        *(ROOT / name for name in ELSEWHERE),
        *(path for path in (ROOT / "docs").rglob("*.md") if not path.name.endswith(MADE)),
    ]
)


def runnable() -> list[Any]:
    """Return parameters of a test: the pages that have blocks to run, long ones first."""
    pages = [page for page in PAGES if _runs(page)]
    return [
        pytest.param(page, id=str(page.relative_to(ROOT)), marks=_marks_of(page))
        for page in sorted(pages, key=_commands_of, reverse=True)
    ]


def _runs(page: Path) -> bool:
    return any(not example.parsed.values("not run") for example in blocks_of(page))


def _marks_of(page: Path) -> list[pytest.MarkDecorator]:
    """All pages but the first that one reads are slow, those with mpirun need MPI."""
    marks = [] if page in SHORT else [pytest.mark.slow]
    return [*marks, pytest.mark.mpi] if "mpirun" in page.read_text() else marks


def _commands_of(page: Path) -> int:
    """Return the number of lines of shell that are run."""
    blocks: list[Block] = [example.parsed for example in blocks_of(page)]
    shell = [block for block in blocks if block.language == "sh" and not block.values("not run")]
    return sum(block.source.count("\n") + len(block.values("prepared")) for block in shell)
