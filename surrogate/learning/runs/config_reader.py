"""The configuration of a run: keys `model` and `likelihood` choose the kind of model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from shared_schema.common.arguments import checked_arguments
from shared_schema.common.configuration import changed, source_of
from surrogate.learning.models.kinds import run_config
from surrogate.learning.models.model import Model
from surrogate.learning.runs.recipes import Data, case_of, named, read_recipe

Config = Model | Mapping[str, Any] | str | Path


@checked_arguments
def read_config(config: Config, *, changes: Sequence[str] = (), data: Data | None = None) -> Model:
    """Read the configuration of a training.

    Parameters
    ----------
    config : Model, mapping, str or Path
        Configuration itself, its content as plain data, a YAML file, or the name of a shipped
        recipe, such as ``"beam2d-det-fast"``.
    changes : sequence of str
        New values of keys, such as ``"training.epochs=20"``. With any, `recipe` is ``custom``.
    data : Dataset, str, Path or sequence of str or Path, optional
        Dataset that names the case, unless the configuration does.

    Raises
    ------
    InputError
        If there is no such configuration, or one of its keys or values is wrong.
    """
    if isinstance(config, Model):
        if not changes:
            return config
        content, source = config.plain(), f"config '{config.name}'"
    elif isinstance(config, Mapping):
        content, source = dict(config), "config"
        if "case" not in content and data is not None:
            content = named(content, case_of(data), "own")
    else:
        content, source = read_recipe(str(config), data)
    if changes:
        content = changed({**content, "recipe": "custom"}, changes)
    return run_config(content, source_of(source, changes))
