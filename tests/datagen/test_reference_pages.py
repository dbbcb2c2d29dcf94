"""Pages of the reference that are made from the factory."""

from __future__ import annotations

import shlex

from datagen.cases.case import Case
from datagen.command_line import _parser
from shared_schema.loads.family import SHIPPED
from website.reference import commands_of, pages_of


def test_pages() -> None:
    pages = pages_of("datagen")
    assert all(f"| `{key}` |" in pages["case-keys.md"] for key in Case.model_fields)
    assert all(name in pages["case-keys.md"] for name in SHIPPED)
    assert "## datagen structure\n" in pages["datagen-commands.md"]
    assert r"`--out FILE.(npz\|vtu\|xdmf)`" in pages["datagen-commands.md"]


def test_examples_of_the_help_are_commands() -> None:
    parser = _parser()
    for command in commands_of(parser).values():
        for line in (command.epilog or "").splitlines()[1:]:
            words = shlex.split(line.partition(" > ")[0])
            parser.parse_args(words[words.index("datagen") + 1 :])
