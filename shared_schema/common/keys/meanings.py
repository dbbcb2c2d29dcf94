"""What the keys of a configuration mean, as the docstrings of their models say it.

The section ``Attributes`` of a model's docstring (NumPy style) has an entry for every key::

    radius : float
        R in m.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator

ENTRY = re.compile(r"^(?P<names>\w[\w, ]*?) : \S")
UNIT = re.compile(r"\bin (m²|m|N/m³|N/m|N|Pa|MB|s|%)(?=[\s.,;:)]|$)")


def meanings_of(model: type) -> dict[str, str]:
    """Return the meaning of every key by its name; a model's own words go before its bases'."""
    found: dict[str, str] = {}
    for base in reversed(model.__mro__):
        found |= dict(_entries(base.__doc__ or ""))
    return found


def summary_of(model: type) -> str:
    """Return the first paragraph of a model's docstring in one line."""
    return " ".join(inspect.cleandoc(model.__doc__ or "").partition("\n\n")[0].split())


def unit_of(meaning: str) -> str:
    """Return the unit that a meaning names, such as N of "Tolerance in N."; empty if none."""
    found = UNIT.search(meaning)
    return found.group(1) if found else ""


def _entries(docstring: str) -> Iterator[tuple[str, str]]:
    """Yield name and meaning of every entry that has a meaning."""
    _, _, section = inspect.cleandoc(docstring).partition("\nAttributes\n----------\n")
    names: list[str] = []
    lines: list[str] = []
    for line in [*section.splitlines(), ""]:
        if line.startswith(" "):
            lines.append(line.strip().replace("``", "`"))
            continue
        if lines:
            yield from ((name, " ".join(lines)) for name in names)
        lines, entry = [], ENTRY.match(line)
        names = entry.group("names").replace(" ", "").split(",") if entry else []
