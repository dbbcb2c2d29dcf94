"""JSON Schema of configurations, with meaning and unit of every key, for editors and for lists."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from pydantic import BaseModel, TypeAdapter
from pydantic.json_schema import GenerateJsonSchema, JsonSchemaValue, models_json_schema
from pydantic_core import core_schema

from shared_schema.common.keys.meanings import meanings_of, summary_of, unit_of

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
