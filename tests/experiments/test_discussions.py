"""Numbers in the discussions of reports are those of the records beside them."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from shared_schema.common import read_yaml
from tests.end_to_end.commands import ROOT

DISCUSSIONS = sorted((ROOT / "docs").glob("*/*/discussion.yaml"))
NUMBER = r"(?<![\w.])\d+(?:\.\d+)?(?!\w)"


def numbers(content: Any) -> Iterator[float]:
    """All numbers of plain data, those in texts included."""
    if isinstance(content, str):
        yield from map(float, re.findall(r"\d+(?:\.\d+)?", content))
    elif isinstance(content, dict):
        yield from numbers(list(content.values()))
    elif isinstance(content, list):
        for value in content:
            yield from numbers(value)
    elif content is not None:
        yield float(content)


@pytest.mark.parametrize("path", DISCUSSIONS, ids=lambda path: path.parent.name)
def test_numbers_are_in_the_records(path: Path) -> None:
    """Rounded as in the text: those of a study in its own record, others in any of the report."""
    discussion = read_yaml(path)
    records = {file.stem: json.loads(file.read_text()) for file in path.parent.glob("*.json")}
    texts = [(discussion["introduction"], list(records.values()))]
    texts += [(text, [records[name]]) for name, text in discussion.get("studies", {}).items()]
    for text, sources in texts:
        known = list(numbers(sources))
        for said in re.findall(NUMBER, re.sub(r"\]\([^)]*\)", "]", text)):
            decimals = len(said.partition(".")[2])
            nearest = min(abs(value - float(said)) for value in known)
            assert nearest <= 0.5001 * 10**-decimals, said


def test_discussions_are_found() -> None:
    assert {path.parent.name for path in DISCUSSIONS} == {"laptop", "plane", "space", "touch"}
