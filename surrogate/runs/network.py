"""The network of a run, as its description says, and what it takes from the data at the start."""

from __future__ import annotations

import torch
from torch import nn

from shared_schema.common.errors import InputError
from surrogate.baselines.linear_map import LinearMap, compliance_of
from surrogate.baselines.pod import PODNetwork
from surrogate.data.dataset import Dataset, Samples
from surrogate.data.geometry import Geometry
from surrogate.networks.field_network import FieldNetwork
from surrogate.networks.unet import UNet
from surrogate.probabilistic.ensemble import Ensemble
from surrogate.probabilistic.likelihoods import output_channels
from surrogate.runs.configuration import RunConfig
from surrogate.runs.description import RunDescription
from surrogate.seeds import INITIAL_WEIGHTS, stream


def make_network(description: RunDescription, geometry: Geometry) -> FieldNetwork:
    """Build the network of a run with the initial weights that its seed gives."""
    config, data = description.run, description.data
    free = torch.from_numpy(geometry.free_mask)
    network: nn.Module
    if config.model == "linear":
        network = LinearMap(data.dimension, free)
    elif config.pod is not None:
        network = PODNetwork(config.pod, free)
    else:
        members = [_unet(config, data.dimension, member) for member in range(config.ensemble)]
        network = Ensemble(members) if config.ensemble > 1 else members[0]
    return FieldNetwork(network, geometry, data.info)


def _unet(config: RunConfig, dimension: int, member: int) -> UNet:
    """A U-Net; the first member of an ensemble is the one that would be alone."""
    others = (member,) if member else ()
    torch.manual_seed(stream(config.seed, INITIAL_WEIGHTS, *others))
    outputs = output_channels(config.likelihood, dimension)
    return UNet(dimension, outputs, config.network, config.variational, member)


def require_suitable(config: RunConfig, dataset: Dataset, train: Samples) -> None:
    """Raise InputError unless the data are what the model needs."""
    where = f"config '{config.name}': key"
    if config.model == "linear":
        if not dataset.geometry.grid.points_are_nodes:
            raise InputError(
                f"{where} 'model' = 'linear': the dataset's grid is embedded on its mesh, expected "
                "one whose points are nodes"
            )
        if dataset.stiffness is None:
            raise InputError(
                f"{where} 'model' = 'linear': the dataset has no stiffness; make it again, by "
                "'datagen structure' into a new folder"
            )
    if config.pod is not None and config.pod.rank is not None:
        most = min(len(train), dataset.geometry.dimension * int(dataset.geometry.free_mask.sum()))
        if config.pod.rank > most:
            raise InputError(
                f"{where} 'pod.rank' = {config.pod.rank}: expected {most} at most, the smaller of "
                "the numbers of training samples and of free degrees of freedom"
            )


def start_from_data(
    network: FieldNetwork, config: RunConfig, dataset: Dataset, train: Samples
) -> None:
    """Give a network of the CPU what it takes from the data before any training.

    Scales by node; of the linear model K⁻¹; of proper orthogonal decomposition the whole fit.
    """
    if config.displacement_scale == "node":
        network.scale_by_node(train.displacement)
    inner, geometry = network.network, dataset.geometry
    if isinstance(inner, LinearMap):
        assert dataset.stiffness is not None
        compliance = compliance_of(dataset.stiffness, geometry.grid, geometry.clamped)
        inner.start_at(compliance, network.force_scale, network.displacement_scale)
    elif isinstance(inner, PODNetwork):
        inner.fit(
            train.force / network.force_scale,
            train.displacement / network.displacement_scale,
            stream(config.seed, INITIAL_WEIGHTS),
        )
