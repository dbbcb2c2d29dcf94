"""Docstrings are written in reStructuredText; the site reads them as Markdown."""

from __future__ import annotations

import re
import textwrap
from typing import Any

import griffe

ROLE = re.compile(r":math:`([^`]*)`")
DIRECTIVE = re.compile(r"^( *)\.\. math:: *(.*\n(?:(?:\1 +.*)?\n)*)", re.MULTILINE)
TABLE = re.compile(
    r"^(?P<border> *=+(?: +=+)+)\n(?P<first>(?:.*\S.*\n)+?)(?P=border)"
    r"(?:\n(?P<second>(?:.*\S.*\n)+?)(?P=border))?$",
    re.MULTILINE,
)


def markdown(text: str) -> str:
    """Translate formulas and simple tables of reStructuredText to Markdown."""
    text = TABLE.sub(_table, DIRECTIVE.sub(_formula, text + "\n"))
    return ROLE.sub(lambda role: f"${' '.join(role[1].split())}$", text).rstrip()


def _formula(directive: re.Match[str]) -> str:
    indent, body = directive[1], directive[2]
    return f"\n{indent}$$ {' '.join(body.split())} $$\n\n"


def _table(table: re.Match[str]) -> str:
    """Translate a table; a row without a first cell goes on with the row above it."""
    starts = [column.start() for column in re.finditer("=+", table["border"])]
    ends = [*starts[1:], None]
    parts = [table["first"], table["second"]] if table["second"] else ["", table["first"]]
    head, body = (
        [
            [line[start:end].strip() for start, end in zip(starts, ends, strict=True)]
            for line in part.splitlines()
        ]
        for part in parts
    )
    rows: list[list[str]] = []
    for cells in body:
        if cells[0]:
            rows.append(cells)
        else:
            rows[-1] = [f"{a} {b}".strip() for a, b in zip(rows[-1], cells, strict=True)]
    lines = [head[0] if head else [""] * len(starts), ["---"] * len(starts), *rows]
    text = "\n".join(f"| {' | '.join(cells)} |" for cells in lines)
    return text.replace(r"\|", r"\Vert ")  # a bar would end the cell


class DocstringText(griffe.Extension):
    """Translate every docstring."""

    def on_object(self, *, obj: griffe.Object, **_: Any) -> None:
        """Translate the docstring of one object."""
        if obj.docstring is not None:
            obj.docstring.value = markdown(textwrap.dedent(obj.docstring.value))
