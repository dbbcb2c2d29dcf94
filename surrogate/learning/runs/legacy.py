"""Run folders of version 1, whose ``config.yaml`` lists every key of every kind of model."""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from typing import Any

from pydantic import BaseModel

from surrogate.learning.models.model import Model

RENAMED = {  # keys of version 1, by section
    "variational": {"divergence": "kl_divergence", "spread": "posterior_std"},
    "training": {"residency": "samples_on"},
    "network": {"inputs": "force_transforms"},
}


def upgraded(run: Mapping[str, Any], kind: type[Model]) -> dict[str, Any]:
    """Convert a configuration of version 1 to the present one of a kind of model.

    Renamed keys get their present names. Keys that the kind of model does not read are dropped.
    """
    content = dict(run)
    for section, names in RENAMED.items():
        if isinstance(content.get(section), Mapping):
            old = content[section].items()
            content[section] = {names.get(key, key): value for key, value in old}
    network, members = content.get("network"), content.get("ensemble", 1)
    if isinstance(network, Mapping) and "force_transforms" in network:
        used = network["force_transforms"][:members]
        content["network"] = {**network, "force_transforms": used}
    return _known(content, kind)


def _known(content: Mapping[str, Any], model: type[BaseModel]) -> dict[str, Any]:
    """Drop the keys that a configuration class does not have, also in nested sections."""
    kept = {}
    for name, value in content.items():
        field = model.model_fields.get(name)
        if field is None:
            continue
        section = field.annotation
        if isinstance(value, Mapping) and inspect.isclass(section):
            value = _known(value, section) if issubclass(section, BaseModel) else value
        kept[name] = value
    return kept
