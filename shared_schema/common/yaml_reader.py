"""YAML as configurations need it: each key once, no bombs, and numbers as people write them."""

from __future__ import annotations

import re
from typing import Any

import yaml

MOST_VALUES = 100_000  # of a file, values that aliases and merge keys repeat counted each time
MERGE = "<<"
WHOLE = re.compile(r"^[-+]?[0-9][0-9_]*$")
NUMBER = re.compile(r"^[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)[eE][-+]?[0-9]+$")


class _Loader(yaml.SafeLoader):
    """Safe loader that reads numbers as YAML 1.2 does.

    For YAML 1.1, 1e-3 is text, 010 is 8, and 1:30 is 90.
    """


def _whole_number(loader: _Loader, node: yaml.ScalarNode) -> int | str:
    if ":" in node.value:
        return str(node.value)
    return int(node.value, 10) if WHOLE.match(node.value) else loader.construct_yaml_int(node)


def _number(loader: _Loader, node: yaml.ScalarNode) -> float | str:
    return str(node.value) if ":" in node.value else loader.construct_yaml_float(node)


_Loader.add_implicit_resolver("tag:yaml.org,2002:float", NUMBER, list("-+.0123456789"))
_Loader.add_constructor("tag:yaml.org,2002:int", _whole_number)
_Loader.add_constructor("tag:yaml.org,2002:float", _number)


def yaml_content(text: str) -> Any:
    """Read a YAML document of plain data.

    Raises
    ------
    yaml.YAMLError
        If the text is not valid YAML, a key is no name or occurs twice, a value contains itself, or
        aliases repeat values so often that there are more than `MOST_VALUES`.
    """
    loader = _Loader(text)
    try:
        node = loader.get_single_node()
        if node is None:
            return None
        _count(node, {})
        return loader.construct_document(node)
    finally:
        loader.dispose()


def _count(node: yaml.Node, counted: dict[int, int]) -> int:
    """Number of values in a node, repeated ones each time; YAMLError if there are too many."""
    if isinstance(node, yaml.ScalarNode):
        return 1
    if id(node) in counted:
        if counted[id(node)] == 0:
            raise _problem("a value contains itself", node)
        return counted[id(node)]
    counted[id(node)] = 0
    parts = list(node.value)
    if isinstance(node, yaml.MappingNode):
        keys: set[str] = set()
        for key, _ in node.value:
            if not isinstance(key, yaml.ScalarNode):
                raise _problem("a list or a mapping as a key, expected a name", key)
            if key.value in keys:
                raise _problem(f"key '{key.value}' occurs twice", key)
            if key.value != MERGE:
                keys.add(key.value)
        parts = [part for pair in node.value for part in pair]
    total = 1 + sum(_count(part, counted) for part in parts)
    if total > MOST_VALUES:
        raise _problem(f"more than {MOST_VALUES} values, with those that aliases repeat", node)
    counted[id(node)] = total
    return total


def _problem(text: str, node: yaml.Node) -> yaml.YAMLError:
    return yaml.constructor.ConstructorError(None, None, text, node.start_mark)
