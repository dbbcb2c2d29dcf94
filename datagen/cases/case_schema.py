"""The keys of a case file: as JSON Schema, and as a list."""

from __future__ import annotations

import importlib
from typing import Any

from datagen.cases.case import Case
from datagen.loads.family import SHIPPED, LoadFamily
from shared_schema.keys.json_schema import DIALECT, Schema, json_schemas
from shared_schema.keys.key_list import Key, keys_of

TITLE = "Case of datagen"
OWN_FAMILY = "FILE.py:ClassName"


def case_schema() -> Schema:
    """Return the JSON Schema of a case; its load is one of the shipped families, or a user's own.

    The keys of a user's own family are not known, so that any are allowed.
    """
    families = [_family(place) for place in SHIPPED.values()]
    (case, own, *shipped), definitions = json_schemas([Case, LoadFamily, *families])
    named = list(zip([OWN_FAMILY, *SHIPPED], [own, *shipped], strict=True))
    for name, reference in named:
        definition = definitions[_name(reference)]
        family = definition["properties"]["family"]
        del definition["properties"]["family_sha256"]
        if name == OWN_FAMILY:
            definition["additionalProperties"] = True
            family |= {"pattern": r"\.py:[A-Za-z_]\w*$", "x-tag": name}
        else:
            family["const"] = name
    content: dict[str, Any] = definitions.pop(_name(case))
    load = content["properties"]["load"]
    options = [reference for _, reference in [*named[1:], named[0]]]
    content["properties"]["load"] = {"description": load["description"], "oneOf": options}
    return {"$schema": DIALECT, "title": TITLE, **content, "$defs": definitions}


def case_keys() -> list[Key]:
    """List all keys of a case."""
    return keys_of(case_schema())


def _family(place: str) -> type[LoadFamily]:
    module, _, class_name = place.partition(":")
    family: type[LoadFamily] = getattr(importlib.import_module(module), class_name)
    return family


def _name(reference: Schema) -> str:
    """Name of the definition that a reference is to."""
    return str(reference["$ref"]).rpartition("/")[2]
