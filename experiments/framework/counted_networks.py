"""Networks with numbers of loads, as options of a benchmark: ``beam2d_any:200``."""

from __future__ import annotations

from collections.abc import Sequence

from shared_schema.common import Parser

__all__ = ["add_counted_networks", "counted_networks"]


def add_counted_networks(parser: Parser, default: Sequence[str], what: str, seed: int) -> None:
    """Add networks with a number of something each, and the seed of what is drawn."""
    said = f"network and number of {what} (default {' '.join(default)})"
    parser.add_argument("networks", nargs="*", default=default, metavar="NAME:N", help=said)
    parser.add_argument("--seed", type=int, default=seed)


def counted_networks(texts: Sequence[str]) -> list[tuple[str, int]]:
    """Networks and numbers."""
    pairs = [text.rpartition(":") for text in texts]
    return [(name, int(count)) for name, _, count in pairs]
