"""The page of the parts has a line for every room of both programs."""

from __future__ import annotations

import re

import pytest

from tests.end_to_end.commands import ROOT
from tests.end_to_end.test_architecture import LAYERS

PAGE = (ROOT / "docs" / "background" / "parts.md").read_text()


@pytest.mark.parametrize("program", ["datagen", "surrogate"])
def test_every_room_has_a_line_in_the_order_of_the_layers(program: str) -> None:
    table = PAGE.partition(f"| `{program}` | room |")[2].partition("\n\n")[0]
    shown = re.findall(r"^\|[^|]*\| `([\w.]+)` \|", table, re.MULTILINE)
    layers = [
        {
            name
            for name in layer
            if (ROOT / program / name.replace(".", "/") / "__init__.py").is_file()
        }
        for layer in LAYERS[program]
    ]
    assert len(set(shown)) == len(shown)
    for layer in filter(None, layers):
        assert set(shown[: len(layer)]) == layer
        shown = shown[len(layer) :]
    assert not shown
