"""The configuration of a run: keys `model` and `likelihood` choose the kind of model."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from shared_schema.common.changed_keys import changed, source_of
from shared_schema.common.configuration import validate
from surrogate.models.kinds import ADAPTER
from surrogate.models.model import Model
from surrogate.runs.recipes import Data, read_recipe


def read_config(name: str, changes: Sequence[str] = (), data: Data | None = None) -> Model:
    """Read a configuration from a YAML file, or a shipped recipe by its name.

    Parameters
    ----------
    name : str
        See `read_recipe`.
    changes : sequence of str
        New values of keys, such as ``training.epochs=20`` (`changed`). With any, `recipe` is
        ``custom``.
    data : Dataset, str, Path or sequence of str or Path, optional
        Dataset that names the case, unless the configuration does.

    Raises
    ------
    InputError
        If there is no such configuration, or one of its keys or values is wrong.
    """
    content, file = read_recipe(name, data)
    if changes:
        content = changed({**content, "recipe": "custom"}, changes)
    return run_config(content, source_of(file, changes))


def run_config(content: Any, source: str = "config") -> Model:
    """Build a configuration from plain data; an InputError names the first wrong key."""
    return validate(ADAPTER, content, source)
