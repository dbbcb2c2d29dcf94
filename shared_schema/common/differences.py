"""Differences of two nested mappings, key by key."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

LONGEST = 200  # characters of a value in a message


def differences(
    old: Mapping[str, Any], new: Mapping[str, Any], above: str = ""
) -> dict[str, tuple[Any, Any]]:
    """Return old and new value of every key that differs, None where a mapping lacks it.

    Parameters
    ----------
    old, new : mapping
        Keys of mappings in them are joined by points.
    above : str
        What stands before every key.

    Returns
    -------
    dict of str to tuple
        In the order of `old`, then of `new`.
    """
    found: dict[str, tuple[Any, Any]] = {}
    for key in [*old, *(key for key in new if key not in old)]:
        a, b = old.get(key), new.get(key)
        if isinstance(a, dict) and isinstance(b, dict):
            found |= differences(a, b, f"{above}{key}.")
        elif a != b:
            found[above + key] = (a, b)
    return found


def difference_text(key: str, old: Any, new: Any) -> str:
    """Say how a key differs from what a folder has."""
    return f"{key} = {_short(new)}, the folder has {_short(old)}"


def _short(value: Any) -> str:
    """Write a value, the beginning of it if it is long, such as a list of nodes."""
    text = repr(value)
    return text if len(text) <= LONGEST else text[:LONGEST] + " …"
