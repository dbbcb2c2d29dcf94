"""The keys of a case file: as JSON Schema, and as a list."""

from __future__ import annotations

import importlib
from typing import Any

from datagen.cases.case import Case
from shared_schema.common.configuration_keys import DIALECT, Key, Schema, json_schemas, keys_of
from shared_schema.loads.family import SHIPPED, LoadFamily
from shared_schema.materials import SHIPPED as SHIPPED_MATERIALS
from shared_schema.materials import OwnMaterial

TITLE = "Case of datagen"
OWN_CLASS = "FILE.py:ClassName"


def case_schema() -> Schema:
    """Return the JSON Schema of a case.

    Load and material are each one of the shipped kinds, a user's own, or a list of some. The keys
    of a user's own class are not known, so that any are allowed.
    """
    families = [_family(place) for place in SHIPPED.values()]
    models = list(SHIPPED_MATERIALS.values())
    (case, *parts), definitions = json_schemas([Case, *families, LoadFamily, *models, OwnMaterial])
    content: dict[str, Any] = definitions.pop(_name(case))
    count = len(families) + 1
    for section, tag, references, names in (
        ("load", "family", parts[:count], SHIPPED),
        ("material", "model", parts[count:], SHIPPED_MATERIALS),
    ):
        for name, reference in zip([*names, OWN_CLASS], references, strict=True):
            definition = definitions[_name(reference)]
            definition["properties"].pop(f"{tag}_sha256", None)
            key = definition["properties"][tag]
            if name == OWN_CLASS:
                definition["additionalProperties"] = True
                key |= {"pattern": r"\.py:[A-Za-z_]\w*$", "x-tag": name}
            else:
                key["const"] = name
            if "default" not in key or name != "neo_hookean":
                required = definition.setdefault("required", [])
                definition["required"] = sorted({*required, tag})
        several = {"type": "array", "minItems": 1, "items": {"oneOf": references}}
        meaning = content["properties"][section]["description"]
        content["properties"][section] = {
            "description": meaning,
            "oneOf": [*references, several],
        }
    return {"$schema": DIALECT, "title": TITLE, **content, "$defs": definitions}


def case_keys() -> list[Key]:
    """List all keys of a case."""
    return keys_of(case_schema())


def _family(place: str) -> type[LoadFamily]:
    module, _, class_name = place.partition(":")
    return getattr(importlib.import_module(module), class_name)


def _name(reference: Schema) -> str:
    """Name of the definition that a reference is to."""
    return str(reference["$ref"]).rpartition("/")[2]
