"""The keys of a configuration, listed with type, unit, default and meaning.

What a key means says the docstring of its model. The section ``Attributes`` of a model's docstring
(NumPy style) has an entry for every key::

    radius : float
        R in m.

pydantic makes a JSON Schema of the models, with these meanings, for editors; the command ``schema``
of both programs lists the keys in it.
"""

from __future__ import annotations

import argparse
import inspect
import json
import re
import textwrap
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from pydantic import BaseModel, TypeAdapter
from pydantic.json_schema import GenerateJsonSchema, JsonSchemaValue, models_json_schema
from pydantic_core import core_schema

from shared_schema.common.command_line import Parser
from shared_schema.common.errors import InputError

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


DIALECT = "https://json-schema.org/draft/2020-12/schema"
Schema = dict[str, Any]


class KeySchema(GenerateJsonSchema):
    """pydantic's generator, with ``description`` and ``x-unit`` from the models' docstrings."""

    schema_dialect = DIALECT

    def model_schema(self, schema: core_schema.ModelSchema) -> JsonSchemaValue:
        """Describe a model and its keys."""
        made = super().model_schema(schema)
        model = schema["cls"]
        made["description"] = summary_of(model)
        meanings = meanings_of(model)
        for name, key in made.get("properties", {}).items():
            if name in meanings:
                key["description"] = meanings[name]
                if unit := unit_of(meanings[name]):
                    key["x-unit"] = unit
        return made


def json_schema(of: TypeAdapter[Any], title: str) -> Schema:
    """Return the JSON Schema of the files that an adapter reads."""
    made = of.json_schema(schema_generator=KeySchema)
    return {"$schema": DIALECT, "title": title, **made}


def json_schemas(models: Sequence[type[BaseModel]]) -> tuple[list[Schema], Schema]:
    """Return a reference to the schema of each model, and the definitions that they refer to."""
    references, joint = models_json_schema(
        [(model, "validation") for model in models], schema_generator=KeySchema
    )
    return [references[model, "validation"] for model in models], joint["$defs"]


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
        Names from the top, with points between them as for ``--set``; N counts entries of a list,
        and NAME is one that the configuration chooses.
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
                named = part.get("additionalProperties")
                each = self.options(self.resolved(named)) if isinstance(named, dict) else []
                kinds = {kind["title"]: kind for kind in each if "properties" in kind}
                of_kinds = {name: list(self.keys(k, f"{here}.NAME.")) for name, k in kinds.items()}
                yield from joined(of_kinds, " or ".join)

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


def add_arguments(parser: Parser) -> None:
    """Add KEY and --format."""
    parser.add_argument(
        "key", nargs="?", default="", metavar="KEY", help="only this key or section"
    )
    parser.add_argument(
        "--format",
        choices=("text", "markdown", "json"),
        default="text",
        help="text (default), a table in Markdown, or JSON Schema for editors",
    )


def printed(options: argparse.Namespace, keys: Sequence[Key], schema: Schema) -> str:
    """Return what the command prints; InputError if there is no such key."""
    if options.format == "json":
        if options.key:
            raise InputError(f"KEY '{options.key}': expected none with --format json")
        return json.dumps(schema, indent=1, ensure_ascii=False)
    part = options.key
    chosen = [key for key in keys if f"{key.name}.".startswith(f"{part}." if part else "")]
    if not chosen:
        sections = dict.fromkeys(key.name for key in keys if "." not in key.name)
        raise InputError(f"KEY '{part}': no such key, expected one of {', '.join(sections)}")
    return as_markdown(chosen) if options.format == "markdown" else as_text(chosen)
