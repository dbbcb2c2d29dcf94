"""Code blocks of all pages run; what does not run says why."""

from __future__ import annotations

from pathlib import Path

import pytest

from surrogate.learning.models import kinds
from tests.documentation.page import Block, blocks_of
from tests.documentation.pages import PAGES, runnable
from tests.end_to_end.commands import ROOT


@pytest.mark.parametrize("page", runnable())
def test_blocks_run(page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(kinds, "_ADDED", {})  # a page adds an architecture
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
