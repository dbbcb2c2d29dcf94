"""The kinds of model: every architecture with each of its likelihoods, chosen by two keys.

An architecture is a class with keys and methods; a likelihood is a set of further keys. A kind of
model has both, so that a configuration with any other key is refused.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import reduce
from operator import or_
from typing import TYPE_CHECKING, Annotated, Any, cast, get_args

from pydantic import BaseModel, Discriminator, Tag, TypeAdapter, create_model

from surrogate.learning.models.likelihood_keys import (
    Deterministic,
    GaussianProcess,
    MaximumLikelihood,
    Regression,
    Ridge,
    Untrained,
    VariationalBayes,
)
from surrogate.learning.models.linear_model import LinearModel
from surrogate.learning.models.model import Model
from surrogate.learning.models.pod_model import PODModel
from surrogate.learning.models.reduced_model import ReducedModel
from surrogate.learning.models.series_model import SeriesModel
from surrogate.learning.models.unet_model import UNetModel
from surrogate.learning.networks.reduced_network import VariationalLayers
from surrogate.learning.probabilistic.flipout import VariationalConvolutions

ARCHITECTURES: dict[type[Model], tuple[type[BaseModel], ...]] = {
    UNetModel: (Deterministic, MaximumLikelihood, VariationalBayes[VariationalConvolutions]),
    LinearModel: (Regression,),
    PODModel: (Ridge, GaussianProcess),
    ReducedModel: (Deterministic, MaximumLikelihood, VariationalBayes[VariationalLayers]),
    SeriesModel: (Untrained,),
}


def composed(architecture: type[Model], likelihood: type[BaseModel]) -> type[Model]:
    """Return the class of an architecture with the keys of a likelihood."""
    name = f"{likelihood.__name__.partition('[')[0]}{architecture.__name__}"
    bases = cast("tuple[type[Model], ...]", (likelihood, architecture))
    return create_model(name, __base__=bases, __doc__=likelihood.__doc__)


def tag_of(content: Any) -> str | None:
    """Return the kind of model that a configuration names; None if it is not a mapping."""
    if isinstance(content, Model):
        return tag(content.model, content.likelihood)
    if not isinstance(content, Mapping):
        return None
    return tag(content.get("model", "unet"), content.get("likelihood", "deterministic"))


def tag(model: Any, likelihood: Any) -> str:
    """Return the tag of a kind of model, by the values of its keys `model` and `likelihood`."""
    return f"(model {model}, likelihood {likelihood})"


def only_value(kind: type[Model], key: str) -> str:
    """Return the single value that a kind of model accepts of a key."""
    (value,) = get_args(kind.model_fields[key].annotation)
    return str(value)


_ALL = [composed(part, other) for part, others in ARCHITECTURES.items() for other in others]
globals().update({kind.__name__: kind for kind in _ALL})  # where pickle looks for a class
KINDS: dict[str, type[Model]] = {
    tag(only_value(kind, "model"), only_value(kind, "likelihood")): kind for kind in _ALL
}

if TYPE_CHECKING:
    RunConfig = Model
else:
    tagged = [Annotated[kind, Tag(name)] for name, kind in KINDS.items()]
    RunConfig = Annotated[reduce(or_, tagged), Discriminator(tag_of)]
ADAPTER: TypeAdapter[Model] = TypeAdapter(RunConfig)
