"""The network of a run, as its description says."""

from __future__ import annotations

import torch

from surrogate.field_network import FieldNetwork
from surrogate.geometry import Geometry
from surrogate.likelihoods import output_channels
from surrogate.run_description import RunDescription
from surrogate.seeds import INITIAL_WEIGHTS, stream
from surrogate.unet import UNet


def make_network(description: RunDescription, geometry: Geometry) -> FieldNetwork:
    """Build the network of a run with the initial weights that its seed gives."""
    config, data = description.run, description.data
    torch.manual_seed(stream(config.seed, INITIAL_WEIGHTS))
    outputs = output_channels(config.likelihood, data.dimension)
    unet = UNet(data.dimension, outputs, config.network, config.variational)
    return FieldNetwork(unet, geometry, data.info)
