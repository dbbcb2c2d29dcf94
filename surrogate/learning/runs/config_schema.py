"""The keys of a run's configuration: as JSON Schema, and as a list for all kinds of model."""

from __future__ import annotations

from collections.abc import Sequence

from pydantic import TypeAdapter

from shared_schema.common.configuration_keys import Key, Schema, joined, json_schema, keys_of
from surrogate.learning.models.kinds import kinds, union

TITLE = "Configuration of surrogate train"


def config_schema() -> Schema:
    """Return the JSON Schema of a configuration, one of the kinds of model."""
    return json_schema(union(), TITLE)


def config_keys() -> list[Key]:
    """List the keys of all kinds of model; `Key.only` names the kinds that have a key."""
    lists = [keys_of(json_schema(TypeAdapter(kind), TITLE)) for kind in kinds().values()]
    return joined({_kind(keys): keys for keys in lists}, lambda having: _named(having, lists))


def _kind(keys: Sequence[Key]) -> str:
    """Name a kind of model by the only values of its keys `model` and `likelihood`."""
    of = {key.name: key.type for key in keys}
    return f"{of['model']} {of['likelihood']}"


def _named(having: Sequence[str], lists: Sequence[Sequence[Key]]) -> str:
    """Name some of the kinds, such as "model unet, reduced with variational_bayes"."""
    kinds = [tuple(_kind(keys).split()) for keys in lists]
    models: dict[str, list[str]] = {}  # by the restriction of their likelihoods
    for model in dict.fromkeys(model for model, _ in kinds):
        likelihoods = [likelihood for of, likelihood in kinds if of == model]
        some = [likelihood for likelihood in likelihoods if f"{model} {likelihood}" in having]
        restriction = "" if some == likelihoods else f" with {', '.join(some)}"
        if some:
            models.setdefault(restriction, []).append(model)
    return "; ".join(f"model {', '.join(some)}{rest}" for rest, some in models.items())
