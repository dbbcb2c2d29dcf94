"""Keys of configuration models as a page: name, type, default and meaning of each.

Types and defaults are those of the pydantic fields, meanings those of the docstrings'
``Attributes`` sections.
"""

from __future__ import annotations

import inspect
import json
import re
import types
from collections.abc import Iterator, Mapping
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from pydantic import BaseModel
from pydantic.fields import FieldInfo

Model = type[BaseModel]
ENTRY = re.compile(r"^(?P<names>\w+(?:, \w+)*)(?: : (?P<type>.*))?$")
BOUNDS = {"ge": "≥ {}", "gt": "> {}", "le": "≤ {}", "lt": "< {}"}


def keys_page(title: str, intro: str, models: Mapping[str, Model]) -> str:
    """Describe models, and the models inside them, in one table each.

    Parameters
    ----------
    title, intro : str
    models : mapping of str to model
        Models of the page by their headings. A section that several models have appears once.
    """
    lines, seen = [f"# {title}", "", intro], set[Model]()
    for heading, model in models.items():
        lines += ["", f"## {heading}", *_table(model)]
        for key, section in _sections(model, ""):
            if section not in seen:
                seen.add(section)
                lines += ["", f"### `{_named(key, section)}`", *_table(section)]
    return "\n".join(lines) + "\n"


def _table(model: Model) -> list[str]:
    meanings = documented(model)
    rows = []
    for name, field in model.model_fields.items():
        kind = f"*{type_of(_annotation(field))}; {_default(field)}*"
        text = f"{meanings.get(name, '')} {kind}".strip().replace("|", r"\|")
        rows.append(f"| `{name}` | {text} |")
    return ["", _summary(model), "", "| key | meaning |", "|---|---|", *rows]


def _sections(model: Model, prefix: str) -> Iterator[tuple[str, Model]]:
    """Return the models inside a model with the keys that lead to them."""
    for name, field in model.model_fields.items():
        for section in _models_in(_annotation(field)):
            yield prefix + name, section
            yield from _sections(section, f"{prefix}{name}.")


def _named(key: str, section: Model) -> str:
    """Return the key, with what tells the section from others that may stand there."""
    for name, field in section.model_fields.items():
        values = get_args(field.annotation)
        if get_origin(field.annotation) is Literal and len(values) == 1:
            return f"{key}: {{{name}: {values[0]}}}"
    return key


def _annotation(field: FieldInfo) -> Any:
    return Annotated[field.annotation, *field.metadata] if field.metadata else field.annotation


def documented(model: Model) -> dict[str, str]:
    """Return the meanings of a model's keys, from its docstring and those of its base classes."""
    meanings: dict[str, str] = {}
    for kind in reversed(model.__mro__):
        text = inspect.cleandoc(kind.__dict__.get("__doc__") or "")
        _, _, attributes = text.partition("Attributes\n----------\n")
        names: list[str] = []
        for line in attributes.splitlines():
            entry = ENTRY.match(line)
            if entry is not None:
                names = entry["names"].split(", ")
                meanings |= dict.fromkeys(names, "")
            elif line.startswith(" "):
                for name in names:
                    meanings[name] = f"{meanings[name]} {line.strip()}".strip()
    return meanings


def type_of(annotation: Any) -> str:
    """Describe a type in words of YAML."""
    origin, parts = get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        bounds = [
            text.format(f"{getattr(mark, name):g}")
            for mark in _marks(parts[1:])
            for name, text in BOUNDS.items()
            if getattr(mark, name, None) is not None
        ]
        return ", ".join([type_of(parts[0]), *bounds])
    if origin is Literal:
        return " or ".join(f"`{value}`" for value in parts)
    if origin in (Union, types.UnionType):
        return " or ".join(type_of(part) for part in parts if part is not type(None))
    if origin is tuple:
        one = type_of(parts[0])
        return f"list of {one}" if parts[-1] is Ellipsis else f"list of {len(parts)}: {one}"
    if inspect.isclass(annotation) and issubclass(annotation, BaseModel):
        return "section"
    names = {bool: "true or false", float: "number", int: "whole number", str: "text"}
    return names.get(annotation, str(getattr(annotation, "__name__", annotation)))


def _marks(metadata: tuple[Any, ...]) -> list[Any]:
    marks: list[Any] = []
    for mark in metadata:
        marks += mark.metadata if isinstance(mark, FieldInfo) else [mark]
    return marks


def _models_in(annotation: Any) -> list[Model]:
    if inspect.isclass(annotation) and issubclass(annotation, BaseModel):
        return [annotation]
    return [model for part in get_args(annotation) for model in _models_in(part)]


def _default(field: FieldInfo) -> str:
    if field.is_required():
        return "required"
    value = field.get_default(call_default_factory=True)
    if value is None or isinstance(value, BaseModel):
        return "may be left out"
    plain = list(value) if isinstance(value, tuple) else value
    return f"default `{json.dumps(plain)}`"


def _summary(model: Model) -> str:
    return inspect.cleandoc(model.__doc__ or "").partition("\n\n")[0].replace("\n", " ")
