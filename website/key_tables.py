"""Keys of cases and configurations as a page, from the lists that the command ``schema`` prints."""

from __future__ import annotations

from collections.abc import Sequence

from shared_schema.common.configuration_keys import REQUIRED, Key


def keys_page(title: str, intro: str, keys: Sequence[Key]) -> str:
    """Lay out the keys, a table for every section.

    Parameters
    ----------
    title, intro : str
    keys : sequence of Key
        Those of a section follow each other.
    """
    lines = [f"# {title}", "", intro, "", "## Top level", ""]
    sections: dict[str, list[Key]] = {}
    for key in keys:
        sections.setdefault(key.name.rpartition(".")[0], []).append(key)
    for section, members in sections.items():
        lines += ["", f"## `{section}`", ""] if section else []
        lines += ["| key | meaning |", "|---|---|", *map(_row, members)]
    return "\n".join(lines) + "\n"


def _row(key: Key) -> str:
    default = key.default if key.default in ("", REQUIRED) else f"default `{key.default}`"
    kind = " ".join(filter(None, (key.type, f"in {key.unit}" if key.unit else "")))
    only = f"only {key.only}" if key.only else ""
    small = "; ".join(filter(None, (kind, default, only)))
    cells = f"`{key.name.rpartition('.')[2]}`", f"{key.meaning}<br>*{small}*"
    return f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in cells)} |"
