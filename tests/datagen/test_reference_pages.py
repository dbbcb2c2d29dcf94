"""Pages of the reference that are made from the factory."""

from __future__ import annotations

from datagen.cases.case import Case
from datagen.loads.family import SHIPPED
from website.reference import pages_of


def test_pages() -> None:
    pages = pages_of("datagen")
    assert all(f"| `{key}` |" in pages["case-keys.md"] for key in Case.model_fields)
    assert all(f"## `load: {{family: {name}}}`\n" in pages["case-keys.md"] for name in SHIPPED)
    assert "## datagen structure\n" in pages["datagen-commands.md"]
    assert r"`--out FILE.(npz\|vtu\|xdmf)`" in pages["datagen-commands.md"]
