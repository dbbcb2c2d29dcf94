"""The configuration of a run: keys `model` and `likelihood` choose the kind of model.

A recipe is a configuration that comes with the package. It is for all cases, and then has neither
`name` nor `case`: the dataset names the case. Where the numbers for a case differ, they stand in a
file of its own::

    vb-fast.yaml            all cases
    any-vb-fast.yaml        cases of any load, whose names end with _any
    beam3d-det-fast.yaml    the case beam3d

CASE-RECIPE names the recipe for a case, whichever of these files it is in.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from pydantic import TypeAdapter

from shared_schema.common.arguments import checked_arguments
from shared_schema.common.configuration import changed, names_in, read_yaml, source_of
from shared_schema.common.configuration_keys import Key, Schema, joined, json_schema, keys_of
from shared_schema.common.errors import InputError, nearest
from shared_schema.manifest import read_manifest
from surrogate.learning.models.kinds import kinds, run_config, union
from surrogate.learning.models.model import Model

if TYPE_CHECKING:
    from surrogate.learning.data.dataset import Dataset

Config = Model | Mapping[str, Any] | str | Path
SHIPPED = Path(__file__).parents[2] / "configs"
ANY = "_any"
Data: TypeAlias = "Dataset | str | Path | Sequence[str | Path]"
TITLE = "Configuration of surrogate train"


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


def read_recipe(name: str, data: Data | None = None) -> tuple[dict[str, Any], str]:
    """Read the content of a configuration from a YAML file, or of a recipe by its name.

    Parameters
    ----------
    name : str
        Path of a file, name of a recipe, or CASE-RECIPE.
    data : Dataset, str, Path or sequence of str or Path, optional
        Dataset, its folder, or several folders, that the configuration is for. It names the case if
        neither `name` nor the file does.

    Returns
    -------
    content : dict
    source : str
        Path of the file.

    Raises
    ------
    InputError
        If there is no such file or recipe, or nothing names the case of a recipe.
    """
    if Path(name).is_file():
        content = read_yaml(Path(name))
        if "case" in content or data is None:
            return content, name
        return named(content, case_of(data), Path(name).stem), name
    case, recipe = split_name(name)
    content = read_yaml(file_of(recipe, case))
    if not case and "case" not in content:
        if data is None:
            raise InputError(f"config '{name}': a recipe for all cases, expected CASE-{name}")
        case = case_of(data)
        recipe = recipe.removeprefix("any-") if case.endswith(ANY) else recipe
    file = file_of(recipe, case)
    return named(read_yaml(file), case, recipe), str(file)


def split_name(name: str) -> tuple[str, str]:
    """Split CASE-RECIPE into case and recipe; the case is empty if a recipe has the whole name.

    Raises
    ------
    InputError
        If there is no such recipe.
    """
    parts = name.split("-")
    for count in range(len(parts)):
        case, recipe = "-".join(parts[:count]), "-".join(parts[count:])
        if "/" not in case and file_of(recipe, case).is_file():
            return case, recipe
    shipped = names_in(SHIPPED)
    raise InputError(
        f"config '{name}': no such file, and not one of those shipped ({', '.join(shipped)}) or "
        f"one of them for a case, such as beam2d-det-fast{nearest(name, shipped)}"
    )


def file_of(recipe: str, case: str) -> Path:
    """Return the file of a recipe for a case; the case is empty for all cases."""
    names = [f"{case}-{recipe}", recipe]
    if case.endswith(ANY):
        names.insert(1, f"any-{recipe}")
    files = [SHIPPED / f"{name}.yaml" for name in names]
    return next((file for file in files if file.is_file()), files[-1])


def named(content: dict[str, Any], case: str, recipe: str) -> dict[str, Any]:
    """Return the content of a recipe with the keys `name` and `case`, unless it has them."""
    return {"name": f"{case}-{recipe}", "case": case, **content}


def case_of(data: Data) -> str:
    """Return the name of a dataset's case."""
    if isinstance(data, (str, Path)):
        return read_manifest(Path(data), "structured").name
    return case_of(data[0]) if isinstance(data, Sequence) else data.manifest.name


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
