"""The start of a training from the weights of another run, instead of random ones.

The network begins as the other run's: with its weights and its scales, so that its predictions are
the same. Only factors of a recalibration are dropped; they belong to the finished network.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch

from shared_schema.common.errors import InputError
from surrogate.learning.data.body_check import BodyRecord, require_same_body
from surrogate.learning.data.dataset import Dataset
from surrogate.learning.inference.loading import load
from surrogate.learning.models.model import Model, TrainedModel
from surrogate.learning.networks.field_network import FieldNetwork
from surrogate.learning.runs.description import Origin
from surrogate.learning.runs.folder import first_difference
from surrogate.runtime.tensor_file import tensor_digest

OWN_KEYS = ("name", "case", "recipe", "training", "seed")  # may differ from the other run's


@dataclass(frozen=True)
class WarmStart:
    """The network of another run.

    Attributes
    ----------
    network : FieldNetwork
    origin : Origin
    """

    network: FieldNetwork
    origin: Origin

    def apply(self, network: FieldNetwork) -> None:
        """Give a network of the same kind the weights and scales of the other run."""
        network.load_state_dict(self.network.state_dict())
        network.aleatoric_factor.fill_(1.0)
        network.epistemic_factor.fill_(1.0)
        network.count_factor.set([1.0], [1.0])


def warm_start(run: str | Path, config: Model, dataset: Dataset) -> WarmStart:
    """Read the run that a training starts from.

    Raises
    ------
    InputError
        If the run is not finished or damaged, its network is of another kind than the
        configuration's, or its body is not that of the dataset.
    """
    where = f"--start-from '{run}'"
    if not isinstance(config, TrainedModel):
        raise InputError(f"{where}: config '{config.name}' is fitted directly, expected a network")
    surrogate = load(run)
    description = surrogate.description
    theirs, ours = compared_keys(description.run), compared_keys(config)
    if theirs != ours:
        difference = first_difference(theirs, ours).replace("the folder has", "that run has")
        raise InputError(f"{where}: config '{config.name}' has another {difference}")
    require_same_body(
        BodyRecord(description.data.case, surrogate.geometry.arrays()),
        dataset.body,
        where,
    )
    with torch.no_grad():
        weights = tensor_digest(dict(surrogate.network.state_dict()), {})
    origin = Origin(run=description.run.name, data=description.data.digest, weights=weights)
    return WarmStart(surrogate.network, origin)


def compared_keys(config: Model) -> dict[str, Any]:
    """Return the keys of a configuration in which both runs have to agree."""
    return {key: value for key, value in config.plain().items() if key not in OWN_KEYS}
