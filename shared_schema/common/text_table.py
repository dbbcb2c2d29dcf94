"""Tables of text in columns, as the commands print them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence


def laid_out(rows: Iterable[Sequence[str]]) -> str:
    """Lay out a table, one line a row; every column is as wide as its widest cell."""
    cells = [list(row) for row in rows]
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    lines = (
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True))
        for row in cells
    )
    return "\n".join(line.rstrip() for line in lines)
