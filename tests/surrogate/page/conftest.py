"""One browser for the pages of a test file, and pages that are checked when they are closed."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser

from tests.surrogate.page.browser import OpenPage, chromium


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with chromium() as found:
        yield found


@pytest.fixture
def open_page(browser: Browser) -> Iterator[Callable[..., OpenPage]]:
    """Open pages; at the end, none has asked the network for anything or written to the console."""
    opened: list[OpenPage] = []

    def open_(path: Path, width: int = 1100, height: int = 700) -> OpenPage:
        opened.append(OpenPage(browser, path, width, height))
        return opened[-1]

    yield open_
    for page in opened:
        page.close()
