"""What `surrogate.contrib` adds: places by name, imported at their first use.

No other module knows where a part of `contrib` is. Without one of them the rest works on.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

CONTRIB = {
    "pod": "surrogate.contrib.pod_model.PODModel",  # key `model`
    "balance": "surrogate.contrib.balance",  # command
}


def at(place: str) -> Any:
    """Return what a module has, by the dotted name of both."""
    module, _, name = place.rpartition(".")
    return getattr(import_module(module), name)
