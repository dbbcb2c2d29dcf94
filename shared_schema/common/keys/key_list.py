"""The keys of a JSON Schema as a list: dotted name, type, unit, default and meaning of each."""

from __future__ import annotations

import json
import textwrap
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from shared_schema.common.keys.json_schema import Schema

REQUIRED = "required"
PLAIN = {"number": "number", "integer": "integer", "string": "text", "boolean": "true or false"}
BOUNDS = (
    ("exclusiveMinimum", "> {}"),
    ("minimum", "≥ {}"),
    ("exclusiveMaximum", "< {}"),
    ("maximum", "≤ {}"),
)
NULL = "null"
WIDTH = 100
LONGEST = 10**5  # integer that is spelled out


@dataclass(frozen=True)
class Key:
    """A key of a configuration.

    Attributes
    ----------
    name : str
        Names from the top, with points between them as for ``--set``; N counts entries of a list.
    only : str
        Variant of the section that has the key, such as ``kind: box``; empty if all have it.
    type : str
        Type in words, with bounds.
    unit : str
        SI unit; empty for a number without one.
    default : str
        Default value; "required" if there is none, empty for a section.
    meaning : str
    is_tag : bool
        True if the key has a single value, which tells one variant of a section from the others.
    """

    name: str
    only: str
    type: str
    unit: str
    default: str
    meaning: str
    is_tag: bool = False


def keys_of(schema: Schema) -> list[Key]:
    """List all keys of a JSON Schema, those of sections behind them."""
    return list(_Walk(schema.get("$defs", {})).keys(schema))


def joined(
    variants: Mapping[str, Sequence[Key]], naming: Callable[[Sequence[str]], str]
) -> list[Key]:
    """Join the keys of all variants of a section: a key that several have is listed once.

    Parameters
    ----------
    variants : mapping of str to sequence of Key
        Keys of every variant by its name.
    naming : callable
        Function that names those variants that have a key, if not all have it.
    """
    having: dict[Key, list[str]] = {}
    for variant, keys in variants.items():
        for key in keys:
            having.setdefault(key, []).append(variant)
    names = list(dict.fromkeys(key.name for key in having))
    listed: dict[Key, None] = {}
    for key in sorted(having, key=lambda key: _place(key.name, names)):
        where = having[key]
        if key.is_tag:
            tags = [tag for tag in having if tag.is_tag and tag.name == key.name]
            values = dict.fromkeys(tag.type for tag in tags)
            where = [variant for tag in tags for variant in having[tag]]
            key = replace(tags[0], type=" | ".join(values), is_tag=len(values) == 1)
        if len(where) < len(variants):
            key = replace(key, only="; ".join(filter(None, (naming(where), key.only))))
        listed[key] = None
    return list(listed)


def _place(name: str, names: list[str]) -> tuple[int, ...]:
    """Place of a key in a list: behind its section, in the order of first appearance."""
    parts = name.split(".")
    above = (".".join(parts[: n + 1]) for n in range(len(parts)))
    return tuple(names.index(part) for part in above if part in names)


class _Walk:
    """The way through a schema whose parts refer to definitions."""

    def __init__(self, definitions: Schema) -> None:
        self.definitions = definitions

    def resolved(self, schema: Schema) -> Schema:
        """Return a schema with its reference replaced by what it refers to."""
        if "$ref" not in schema:
            return schema
        target = self.definitions[schema["$ref"].rpartition("/")[2]]
        return {**self.resolved(target), **{k: v for k, v in schema.items() if k != "$ref"}}

    def options(self, schema: Schema) -> list[Schema]:
        """Return the alternatives of a schema, itself if it has none."""
        parts: list[Schema] = schema.get("oneOf") or schema.get("anyOf") or [schema]
        return [self.resolved(part) for part in parts]

    def keys(self, section: Schema, above: str = "") -> Iterator[Key]:
        """Yield the keys of a section and of all sections in it."""
        required = section.get("required", [])
        for name, key in section.get("properties", {}).items():
            schema = self.resolved(key)
            here = f"{above}{name}"
            options = self.options(schema)
            sections = [part for part in options if "properties" in part]
            default = REQUIRED if name in required else ""
            if "default" in schema and not sections:
                default = spelled(schema["default"])
            meaning = key.get("description", schema.get("description", ""))
            unit = schema.get("x-unit", "")
            yield Key(here, "", self.type_of(schema), unit, default, meaning, is_tag(key))
            lists = {tag_of(part): list(self.keys(part, f"{here}.")) for part in sections}
            yield from joined(lists, alternatives)
            for part in options:
                entry = self.resolved(part.get("items") or {})
                if "properties" in entry:
                    yield from self.keys(entry, f"{here}.N.")

    def type_of(self, schema: Schema) -> str:
        """Describe the type of a value."""
        options = self.options(schema)
        if len(options) > 1:
            sections = [tag_of(part) for part in options if "properties" in part]
            rest = [self.type_of(part) for part in options if "properties" not in part]
            named = ["section"] if sections else []
            if any(sections):
                named = [f"section ({alternatives(sections)})"]
            return " or ".join([*named, *rest])
        (schema,) = options
        if is_tag(schema):
            return spelled(schema.get("x-tag", schema.get("const")))
        if "enum" in schema:
            return " | ".join(map(spelled, schema["enum"]))
        if schema.get("type") == "null":
            return NULL
        if schema.get("type") == "array":
            return self._list(schema)
        if schema.get("type") == "object":
            return "section" if "properties" in schema else "mapping"
        bounds = [text.format(spelled(schema[name])) for name, text in BOUNDS if name in schema]
        return " ".join([PLAIN.get(schema.get("type", ""), "value"), *_joined(bounds)])

    def _list(self, schema: Schema) -> str:
        """Describe a list."""
        if "prefixItems" in schema:
            return f"[{', '.join(self.type_of(self.resolved(e)) for e in schema['prefixItems'])}]"
        entry = self.type_of(self.resolved(schema.get("items", {})))
        if entry.startswith("section ("):  # the alternatives stand before the list
            entry = "such section"
        least, most = schema.get("minItems", 0), schema.get("maxItems")
        count = f"{least} to {most}" if most else f"{least} or more" if least else "any number"
        return f"list of {count} × {entry}"


def is_tag(key: Schema) -> bool:
    """True if a key of a section has a single value."""
    return "const" in key or "x-tag" in key


def tag_of(section: Schema) -> str:
    """Return the keys of a section that have one value only, such as ``kind: box``."""
    constants = {
        name: key.get("x-tag", key.get("const"))
        for name, key in section["properties"].items()
        if is_tag(key)
    }
    return ", ".join(f"{name}: {value}" for name, value in constants.items())


def alternatives(tags: Sequence[str]) -> str:
    """Join the tags of some variants, such as "kind: box | lshape"."""
    key, _, first = tags[0].partition(": ")
    rest = [tag.removeprefix(f"{key}: ") for tag in tags[1:]]
    return f"{key}: {' | '.join([first, *rest])}"


def spelled(value: Any) -> str:
    """Spell a value as YAML would have it."""
    if isinstance(value, str):
        return value
    if isinstance(value, float):
        return f"{value:g}" if abs(value) > LONGEST else f"{value:.15g}"
    if value is None:
        return NULL
    if isinstance(value, int) and abs(value) > LONGEST:
        return f"{value:.3g}"
    if isinstance(value, list):
        return f"[{', '.join(map(spelled, value))}]"
    return json.dumps(value)


def _joined(bounds: list[str]) -> list[str]:
    return [", ".join(bounds)] if bounds else []


def as_text(keys: Iterable[Key]) -> str:
    """List keys with their meanings below them, for a terminal."""
    blocks = []
    for key in keys:
        unit = f" in {key.unit}" if key.unit else ""
        default = key.default if key.default in ("", REQUIRED) else f"default {key.default}"
        parts = [f"{key.name}: {key.type}{unit}", default, f"only {key.only}" if key.only else ""]
        lines = ["; ".join(filter(None, parts))]
        indent = " " * 4
        lines += textwrap.wrap(key.meaning, WIDTH, initial_indent=indent, subsequent_indent=indent)
        blocks.append("\n".join(lines))
    return "\n".join(blocks)


def as_markdown(keys: Iterable[Key]) -> str:
    """Lay out keys as a table in Markdown."""
    lines = ["| key | type | unit | default | meaning |", "|---|---|---|---|---|"]
    for key in keys:
        name = f"`{key.name}`" + (f" (only {key.only})" if key.only else "")
        cells = (name, key.type, key.unit, key.default, key.meaning)
        lines.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |")
    return "\n".join(lines)
