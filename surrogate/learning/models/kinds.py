"""The kinds of model: every architecture with each of its likelihoods, chosen by two keys.

An architecture is a class with keys and methods; a likelihood is a set of further keys. A kind of
model has both, so that a configuration with any other key is refused. An architecture is imported
when a configuration names it.

Installed packages add architectures by the entry point ``surrogate.models``, and a script by
`add_model`. A configuration names them, and a run folder its configuration, but neither holds code.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache, reduce
from importlib.metadata import EntryPoint, entry_points
from operator import or_
from typing import TYPE_CHECKING, Annotated, Any, cast, get_args

from pydantic import (
    BaseModel,
    BeforeValidator,
    Discriminator,
    SerializeAsAny,
    Tag,
    TypeAdapter,
    ValidationError,
    create_model,
)

from shared_schema.common.configuration import first_problem
from shared_schema.common.errors import InputError, first_line
from surrogate.extensions import CONTRIB, at
from surrogate.learning.models.model import Model

ARCHITECTURES = {
    "unet": "surrogate.learning.models.unet_model.UNetModel",
    "linear": "surrogate.learning.models.linear_model.LinearModel",
    "pod": CONTRIB["pod"],
    "reduced": "surrogate.learning.models.reduced_model.ReducedModel",
    "series": "surrogate.learning.models.series_model.SeriesModel",
}
GROUP = "surrogate.models"  # of entry points
_ADDED: dict[str, type[Model]] = {}


def add_model(name: str, architecture: type[Model]) -> None:
    """Let configurations of this process name an architecture of one's own as ``model: NAME``.

    Parameters
    ----------
    name : str
        The one value of its key ``model``.
    architecture : type of Model
        A subclass of `surrogate.NetworkModel`, most simply.

    Raises
    ------
    InputError
        If there is one of this name, or the class is no architecture of this name.
    """
    if name in architectures():
        raise InputError(f"model '{name}': there is one already, expected another name")
    _require_architecture(name, architecture)
    _ADDED[name] = architecture


def architectures() -> dict[str, str | EntryPoint | type[Model]]:
    """Where each architecture is, by its name; those of this package come first."""
    installed = {point.name: point for point in entry_points(group=GROUP)}
    return {**installed, **_ADDED, **ARCHITECTURES}


def architecture_of(name: str) -> type[Model]:
    """Import an architecture; InputError if it is somebody else's and no good."""
    place = architectures()[name]
    if isinstance(place, str):
        return cast("type[Model]", at(place))
    if isinstance(place, EntryPoint):
        try:
            found = place.load()
        except Exception as error:
            said = f"'{place.value}' cannot be imported ({first_line(error)})"
            raise InputError(f"model '{name}': {said}") from None
        _require_architecture(name, found)
        return cast("type[Model]", found)
    return place


def _require_architecture(name: str, found: Any) -> None:
    is_model = isinstance(found, type) and issubclass(found, Model)
    if not (is_model and hasattr(found, "likelihoods") and hasattr(found, "title")):
        raise InputError(
            f"model '{name}': expected a subclass of surrogate.NetworkModel with `title` and "
            "`likelihoods`"
        )
    if get_args(found.model_fields["model"].annotation) != (name,):
        raise InputError(
            f"model '{name}': expected the key `model: Literal['{name}']` in its class"
        )


def run_config(content: Any, source: str = "config") -> Model:
    """Build a configuration from plain data; an InputError names the first wrong key."""
    if not isinstance(content, Mapping):
        raise InputError(f"{source}: expected a mapping of keys to values")
    kind, name = kind_of(content), tag_of(content)
    if kind is None:
        model, known = content.get("model", "unet"), architectures()
        if isinstance(model, str) and model not in known:
            raise InputError(
                f"{source}: model '{model}': unknown, expected one of {', '.join(sorted(known))}, "
                "or one of your own after surrogate.add_model, or with an entry point "
                "surrogate.models"
            )
        raise InputError(f"{source}: found {name}, expected one of {', '.join(map(repr, kinds()))}")
    try:
        return kind.model_validate(content)
    except ValidationError as error:
        raise InputError(f"{source}: {first_problem(error, content)} {name}") from None


def kind_of(content: Mapping[str, Any]) -> type[Model] | None:
    """Return the kind of model that a configuration names; None if there is none."""
    model = content.get("model", "unet")
    known = isinstance(model, str) and model in architectures()
    return kinds_of(model).get(tag_of(content)) if known else None


def tag_of(content: Mapping[str, Any]) -> str:
    """Return the tag of a kind of model, by the values of its keys `model` and `likelihood`."""
    model, likelihood = content.get("model", "unet"), content.get("likelihood", "deterministic")
    return f"(model {model}, likelihood {likelihood})"


def kinds() -> dict[str, type[Model]]:
    """Return all kinds of model by their tags."""
    return {name: kind for model in architectures() for name, kind in kinds_of(model).items()}


@cache
def kinds_of(model: str) -> dict[str, type[Model]]:
    """Return the kinds of one architecture by their tags."""
    architecture = architecture_of(model)
    composed = [_composed(architecture, likelihood) for likelihood in architecture.likelihoods]
    globals().update({kind.__name__: kind for kind in composed})  # where pickle looks for a class
    return {tag_of({"model": model, "likelihood": _only_value(kind)}): kind for kind in composed}


def _composed(architecture: type[Model], likelihood: type[BaseModel]) -> type[Model]:
    """Return the class of an architecture with the keys of a likelihood."""
    name = f"{likelihood.__name__.partition('[')[0]}{architecture.__name__}"
    bases = cast("tuple[type[Model], ...]", (likelihood, architecture))
    doc = likelihood.__doc__
    return create_model(name, __base__=bases, __module__=__name__, __doc__=doc)


def _only_value(kind: type[Model]) -> str:
    """Return the single likelihood of a kind of model."""
    (value,) = get_args(kind.model_fields["likelihood"].annotation)
    return str(value)


def __getattr__(name: str) -> type[Model]:
    """Return a class by its name, in a process that has not made it yet."""
    if name.startswith("__"):  # what Python asks of every module
        raise AttributeError(name)
    for kind in kinds().values():
        if kind.__name__ == name:
            return kind
    raise AttributeError(f"module '{__name__}' has no attribute '{name}'")


def union() -> TypeAdapter[Model]:
    """Return all kinds as one type, for its schema."""
    tagged = [Annotated[kind, Tag(name)] for name, kind in kinds().items()]
    every: Any = Annotated[reduce(or_, tagged), Discriminator(tag_of)]
    return TypeAdapter(every)


def _of_its_kind(content: Any) -> Model:
    """Build a configuration inside another one, whose message then names the key of both."""
    if isinstance(content, Model):
        return content
    try:
        return run_config(content, "run")
    except InputError as error:
        raise ValueError(str(error).removeprefix("run: ")) from None


if TYPE_CHECKING:
    RunConfig = Model
else:
    RunConfig = Annotated[SerializeAsAny[Model], BeforeValidator(_of_its_kind)]
