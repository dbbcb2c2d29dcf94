"""Every code block of the README and of the site is run, or says why not."""

from __future__ import annotations

import re
from pathlib import Path

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
PAGES = sorted([*(ROOT / name for name in ELSEWHERE), *(ROOT / "docs").rglob("*.md")])
RUN = [
    page
    for page in PAGES
    if any(not example.parsed.values("not run") for example in blocks_of(page))
]


def marks_of(page: Path) -> list[pytest.MarkDecorator]:
    """Pages with many commands are slow, those with mpirun need MPI."""
    marks = [pytest.mark.slow] if commands_of(page) > 2 else []
    return [*marks, pytest.mark.mpi] if "mpirun" in page.read_text() else marks


def commands_of(page: Path) -> int:
    """Return the number of lines of shell that are run."""
    blocks: list[Block] = [example.parsed for example in blocks_of(page)]
    run = [block for block in blocks if block.language == "sh" and not block.values("not run")]
    return sum(block.source.count("\n") + len(block.values("prepared")) for block in run)


@pytest.mark.parametrize(
    "page",
    [
        pytest.param(page, id=str(page.relative_to(ROOT)), marks=marks_of(page))
        for page in sorted(RUN, key=commands_of, reverse=True)
    ],
)
def test_blocks_run(page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for example in blocks_of(page):
        example.evaluate()


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_reasons_are_reasons(page: Path) -> None:
    """What is not run says why in more than a word, and is changed by no other comment."""
    for example in blocks_of(page):
        block: Block = example.parsed
        reasons = block.values("not run")
        assert all(len(reason.split()) > 1 for reason in reasons)
        assert not reasons or len(block.comments) == 1, (page, example.line)


def test_readme_is_short() -> None:
    assert len((ROOT / "README.md").read_text().splitlines()) <= 120


def test_every_page_is_in_the_navigation() -> None:
    text = (ROOT / "website" / "mkdocs.yml").read_text()
    listed = set(re.findall(r": ([\w/.-]+\.md)$", text, re.MULTILINE))
    pages = {str(page.relative_to(ROOT / "docs")) for page in (ROOT / "docs").rglob("*.md")}
    assert pages <= listed | {p for p in pages if p.startswith(("beyond/", "reproduction/"))}
