"""Code blocks of the tutorials run; a file of its own, since workers share out whole files."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.documentation.pages import TUTORIALS, run, runnable


@pytest.mark.parametrize("page", runnable(lambda page: page.parent == TUTORIALS))
def test_blocks_run(page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    run(page)
