"""The configuration of a run: keys `model` and `likelihood` choose the kind of model."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from shared_schema.common.changed_keys import changed, source_of
from shared_schema.common.configuration import read_named, validate
from surrogate.models.kinds import ADAPTER
from surrogate.models.model import Model

SHIPPED = Path(__file__).parents[1] / "configs"


def read_config(name: str, changes: Sequence[str] = ()) -> Model:
    """Read a configuration from a YAML file, or a shipped one by its name.

    Parameters
    ----------
    name : str
    changes : sequence of str
        New values of keys, such as ``training.epochs=20`` (`changed`). With any, `recipe` is
        ``custom``.

    Raises
    ------
    InputError
        If there is no such configuration, or one of its keys or values is wrong.
    """
    content, file = read_named(name, SHIPPED, "config")
    if changes:
        content = changed({**content, "recipe": "custom"}, changes)
    return run_config(content, source_of(file, changes))


def run_config(content: Any, source: str = "config") -> Model:
    """Build a configuration from plain data; an InputError names the first wrong key."""
    return validate(ADAPTER, content, source)
