"""Marks of all tests of a folder."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from pathlib import Path

import pytest

MARKS = {"documentation": pytest.mark.docs, "experiments": pytest.mark.studies}


@pytest.fixture(autouse=True)
def _loggers_are_left_as_found() -> Iterator[None]:
    """No test silences what a later one reads."""
    before = _levels()
    yield
    assert _levels() == before


def _levels() -> list[tuple[int, bool]]:
    loggers = [logging.getLogger(name) for name in ("datagen", "shared_schema", "surrogate")]
    return [(logging.root.manager.disable, True)] + [(one.level, one.propagate) for one in loggers]


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark tests by the folder of `tests` that they are in."""
    for item in items:
        folder = item.path.relative_to(Path(__file__).parent).parts[0]
        if folder in MARKS:
            item.add_marker(MARKS[folder])
