"""The configuration of a run: keys `model` and `likelihood` choose the kind of model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

from pydantic import Discriminator, Tag, TypeAdapter

from shared_schema.common.changed_keys import changed, source_of
from shared_schema.common.configuration import read_named, validate
from surrogate.models.linear_model import LinearModel
from surrogate.models.model import Model
from surrogate.models.pod_model import GaussianProcessPOD, RidgePOD
from surrogate.models.reduced_model import (
    BayesianReduced,
    DeterministicReduced,
    MaximumLikelihoodReduced,
)
from surrogate.models.unet_model import BayesianUNet, DeterministicUNet, MaximumLikelihoodUNet

SHIPPED = Path(__file__).parents[1] / "configs"
DETERMINISTIC = "(model unet, likelihood deterministic)"
MAXIMUM_LIKELIHOOD = "(model unet, likelihood maximum_likelihood)"
BAYESIAN = "(model unet, likelihood variational_bayes)"
LINEAR = "(model linear, likelihood deterministic)"
RIDGE_POD = "(model pod, likelihood deterministic)"
GAUSSIAN_PROCESS_POD = "(model pod, likelihood maximum_likelihood)"
REDUCED = "(model reduced, likelihood deterministic)"
MAXIMUM_LIKELIHOOD_REDUCED = "(model reduced, likelihood maximum_likelihood)"
BAYESIAN_REDUCED = "(model reduced, likelihood variational_bayes)"


def tag_of(content: Any) -> str | None:
    """Return the kind of model that a configuration names; None if it is not a mapping."""
    if isinstance(content, Model):
        return f"(model {content.model}, likelihood {content.likelihood})"
    if not isinstance(content, Mapping):
        return None
    model, likelihood = content.get("model", "unet"), content.get("likelihood", "deterministic")
    return f"(model {model}, likelihood {likelihood})"


RunConfig = Annotated[
    Annotated[DeterministicUNet, Tag(DETERMINISTIC)]
    | Annotated[MaximumLikelihoodUNet, Tag(MAXIMUM_LIKELIHOOD)]
    | Annotated[BayesianUNet, Tag(BAYESIAN)]
    | Annotated[LinearModel, Tag(LINEAR)]
    | Annotated[RidgePOD, Tag(RIDGE_POD)]
    | Annotated[GaussianProcessPOD, Tag(GAUSSIAN_PROCESS_POD)]
    | Annotated[DeterministicReduced, Tag(REDUCED)]
    | Annotated[MaximumLikelihoodReduced, Tag(MAXIMUM_LIKELIHOOD_REDUCED)]
    | Annotated[BayesianReduced, Tag(BAYESIAN_REDUCED)],
    Discriminator(tag_of),
]
KINDS: dict[str, type[Model]] = {
    DETERMINISTIC: DeterministicUNet,
    MAXIMUM_LIKELIHOOD: MaximumLikelihoodUNet,
    BAYESIAN: BayesianUNet,
    LINEAR: LinearModel,
    RIDGE_POD: RidgePOD,
    GAUSSIAN_PROCESS_POD: GaussianProcessPOD,
    REDUCED: DeterministicReduced,
    MAXIMUM_LIKELIHOOD_REDUCED: MaximumLikelihoodReduced,
    BAYESIAN_REDUCED: BayesianReduced,
}
ADAPTER: TypeAdapter[RunConfig] = TypeAdapter(RunConfig)


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
