"""New values of single keys of a YAML file, as ``--set training.epochs=20`` gives them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import yaml

from shared_schema.common.errors import InputError
from shared_schema.common.yaml_reader import yaml_content


def changed(content: dict[str, Any], changes: Sequence[str]) -> dict[str, Any]:
    """Return the content of a YAML file with other values of some keys.

    Parameters
    ----------
    content : dict
        Content of the file; not changed.
    changes : sequence of str
        Texts ``KEY=VALUE``. The parts of a key are separated by points, and a number counts the
        entries of a list from 0. A value is YAML, and may be a mapping or a list.

    Raises
    ------
    InputError
        If a text is no ``KEY=VALUE``, a value is not valid YAML, or a key leads into a value that
        has no such part.
    """
    for change in changes:
        key, equals, text = change.partition("=")
        parts = key.strip().split(".")
        if not (equals and all(parts)):
            raise InputError(f"--set '{change}': expected KEY=VALUE, such as training.epochs=20")
        try:
            value = yaml_content(text)
        except (yaml.YAMLError, ValueError, RecursionError) as error:
            reason = " ".join(str(error).split())
            raise InputError(f"--set '{change}': not valid YAML ({reason})") from None
        try:
            content = _with(content, parts, value)
        except ValueError as error:
            raise InputError(f"--set '{change}': {error}") from None
    return content


def _with(content: Any, parts: list[str], value: Any, above: str = "") -> Any:
    """Return a copy of nested mappings and lists with another value at one place."""
    if not parts:
        return value
    part, *rest = parts
    here = f"{above}.{part}".strip(".")
    if isinstance(content, dict):
        return {**content, part: _with(content.get(part, {}), rest, value, here)}
    if isinstance(content, list):
        if not (part.isdecimal() and int(part) < len(content)):
            last = len(content) - 1
            raise ValueError(f"key '{here}': expected a number from 0 to {last} after '{above}'")
        place = int(part)
        return [*content[:place], _with(content[place], rest, value, here), *content[place + 1 :]]
    raise ValueError(f"key '{here}': '{above}' = {content!r} has no parts")


def source_of(source: str, changes: Sequence[str]) -> str:
    """Name a file and the changes of its keys, for error messages."""
    return " ".join([source, *(f"--set {change}" for change in changes)])
