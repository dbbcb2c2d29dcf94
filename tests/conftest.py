"""Marks of all tests of a folder."""

from __future__ import annotations

from pathlib import Path

import pytest

MARKS = {"documentation": pytest.mark.docs, "experiments": pytest.mark.studies}


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark tests by the folder of `tests` that they are in."""
    for item in items:
        folder = item.path.relative_to(Path(__file__).parent).parts[0]
        if folder in MARKS:
            item.add_marker(MARKS[folder])
