"""Kinds of model: an architecture with the keys of a likelihood, chosen by a configuration.

====================  ========================================================================
`kinds`               which architecture goes with which likelihoods; the table of all kinds
`model`               what all have: keys of architecture and likelihood, building, distribution
`unet_model`, …       the architectures: U-Net, reduced network, linear layer, POD, load series
`training_config`     keys of the section `training`
`batched_prediction`  a network under any number of loads, in batches that fit memory
====================  ========================================================================
"""

from typing import TYPE_CHECKING

from shared_schema.common.lazy_names import lazy_names

if TYPE_CHECKING:
    from surrogate.learning.models.model import Model, TrainedModel
    from surrogate.learning.models.reduced_model import ReducedModel
    from surrogate.learning.models.unet_model import UNetModel

__all__ = [
    "Model",
    "ReducedModel",
    "TrainedModel",
    "UNetModel",
]
__getattr__, __dir__ = lazy_names(__name__)
