"""Estimate of the memory that a training takes, made before any of it is allocated.

The network is built on torch's device ``meta``, whose tensors have shapes and no values. A batch
is sent through it; autograd says which tensors it keeps for the gradients.
"""

from __future__ import annotations

import torch
from torch import Tensor

from surrogate.learning.models.model import TrainedModel
from surrogate.learning.optim.optimisers import is_hidden_kernel
from surrogate.mechanics.body.geometry import Geometry

META = torch.device("meta")


def training_memory(config: TrainedModel, geometry: Geometry, batch: int) -> int:
    """Estimate the memory of a training in bytes, from below.

    Weights, their gradients, the states of the optimisers, the averages and the best weights, and
    the values of a batch that gradients need.

    Parameters
    ----------
    config : TrainedModel
    geometry : Geometry
    batch : int
        Number of samples of a batch.

    Returns
    -------
    int
        0 for a network that cannot be built without values.
    """
    training, free = config.training, torch.from_numpy(geometry.free_mask)
    kept: dict[int, int] = {}

    def keep(value: Tensor) -> Tensor:
        storage = value.untyped_storage()
        kept[storage._cdata] = storage.nbytes()
        return value

    try:
        with META:
            network = config.make_network(geometry.dimension, free).to(META)
            shape = (batch, config.input_channels(geometry.dimension), *free.shape)
            values = torch.zeros(shape)
        with torch.autograd.graph.saved_tensors_hooks(keep, lambda value: value):
            network(values)
    except NotImplementedError:
        return 0
    copies = 2 + (training.ema is not None) + (training.early_stopping is not None)
    weights = 0
    for name, parameter in network.named_parameters():
        by_muon = training.optimiser.name == "muon" and is_hidden_kernel(name, parameter)
        weights += parameter.nbytes * (copies + (1 if by_muon else 2))
        kept.pop(parameter.untyped_storage()._cdata, None)
    share = 0.5 if training.precision == "bfloat16" else 1
    return weights + int(share * sum(kept.values()))
