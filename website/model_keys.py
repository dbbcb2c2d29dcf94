"""Keys of configuration models as a page: name, type, default and meaning of each.

Types and defaults are those of the pydantic fields, meanings those of the docstrings' ``Attributes``.
"""

from __future__ import annotations

import inspect
import re
import types
from collections.abc import Mapping
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
        Models of the page by their headings; keys of the same model appear once.
    """
    lines, seen = [f"# {title}", "", intro], set[Model]()
    for heading, model in models.items():
        lines += _section(heading, model, seen, level=2)
    return "\n".join(lines) + "\n"


def _section(heading: str, model: Model, seen: set[Model], level: int) -> list[str]:
    seen.add(model)
    lines = ["", f"{'#' * level} {heading}", "", _summary(model), ""]
    lines += ["| key | type | default | meaning |", "|---|---|---|---|"]
    meanings, inner = documented(model), list[tuple[str, Model]]()
    for name, field in model.model_fields.items():
        annotation = Annotated[field.annotation, *field.metadata] if field.metadata else field.annotation
        cells = [f"`{name}`", type_of(annotation), _default(field), meanings.get(name, "")]
        lines.append(f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in cells)} |")
        inner += [(name, part) for part in _models_in(annotation) if part not in seen]
    for name, part in inner:
        if part not in seen:
            prefix = "" if level == 2 and heading.startswith("(") else f"{heading.split(':')[0]}."
            prefix = prefix if level > 2 else ""
            lines += _section(f"{prefix}{name}: {part.__name__}", part, seen, level=3)
    return lines


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
        return " \\| ".join(f"`{value}`" for value in parts).replace("\\|", "or")
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
    if isinstance(value, BaseModel):
        return "as below"
    if value is None:
        return "none"
    if isinstance(value, bool):
        return f"`{str(value).lower()}`"
    return f"`{list(value)}`" if isinstance(value, tuple) else f"`{value}`"


def _summary(model: Model) -> str:
    return inspect.cleandoc(model.__doc__ or "").partition("\n\n")[0].replace("\n", " ")
