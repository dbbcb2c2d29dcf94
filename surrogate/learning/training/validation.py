r"""The loss per datum of a prediction, and the errors of a network on the validation samples.

Errors are those at the nodes of the body: mean absolute errors :math:`e_m` over nodes and
components (`surrogate.learning.measures.error_metrics`). On a grid of nodes they are those on the
grid; on an embedded grid predictions are taken to the nodes and compared with the solutions there.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from surrogate.learning.data.dataset import Dataset
from surrogate.learning.data.samples import Samples
from surrogate.learning.data.samples_on_disk import SamplesOnDisk
from surrogate.learning.models.model import Model
from surrogate.learning.networks.field_network import FieldNetwork
from surrogate.learning.networks.nodal_network import HeldNodes, NodalNetwork
from surrogate.learning.probabilistic.likelihoods import Prediction
from surrogate.learning.training.sample_store import SampleStore
from surrogate.runtime.device import convolutions

BATCH = 256
AT_ONCE = 64  # samples that are prepared at once


@dataclass(frozen=True)
class NodalReference:
    """Solutions at the nodes of a body on an embedded grid.

    Attributes
    ----------
    nodes : NodalNetwork
        Its map from the grid to the nodes.
    displacement : Tensor, (N, d, n_nodes)
        In m, less the linear response if the network's output is added to it.
    """

    nodes: NodalNetwork
    displacement: Tensor

    def errors(self, numbers: Tensor, fields: Tensor) -> Tensor:
        """Mean errors in m of fields on the grid, (M, d, nx, ny[, nz]) → (M,)."""
        predicted = self.nodes.at_nodes(fields)
        reference = self.displacement[numbers.to(self.displacement.device)]
        return (predicted - reference.to(predicted)).abs().flatten(1).mean(dim=1)


@dataclass(frozen=True)
class Reference:
    """What errors of some samples are compared with.

    Attributes
    ----------
    largest : Tensor, (N,)
        Largest displacement of a node of every sample in m.
    nodal : NodalReference, optional
        Solutions at the nodes; on an embedded grid only.
    """

    largest: Tensor
    nodal: NodalReference | None = None

    @classmethod
    def on_grid(cls, samples: Samples | SamplesOnDisk) -> Reference:
        """Compare samples on a grid whose points are the nodes."""
        parts = [
            samples[start : start + BATCH].displacement.norm(dim=1).flatten(1).amax(dim=1)
            for start in range(0, len(samples), BATCH)
        ]
        return cls(torch.cat(parts).cpu() if parts else torch.zeros(0))

    @classmethod
    @torch.no_grad()
    def of(
        cls,
        network: FieldNetwork,
        dataset: Dataset,
        samples: Samples | SamplesOnDisk,
        rows: Tensor,
    ) -> Reference:
        """Compare samples of the training split, given their rows in it."""
        geometry = dataset.geometry
        if geometry.grid.points_are_nodes or len(samples) == 0:
            return cls.on_grid(samples)
        device = network.displacement_rms.device
        nodes = NodalNetwork(network, geometry.grid, HeldNodes(geometry)).to(device)
        u = torch.from_numpy(dataset.nodal_train(rows).displacement).transpose(1, 2).float()
        largest = u.norm(dim=1).amax(dim=1)
        if network.skip:
            for start in range(0, len(samples), AT_ONCE):
                force = samples[start : start + AT_ONCE].force.to(device)
                linear = nodes.linear_response(force)
                _, response = network.inputs_of(force, linear)
                assert response is not None
                of_body = nodes.at_nodes(response * network.movable, linear)
                u[start : start + AT_ONCE] -= of_body.cpu()
        return cls(largest, NodalReference(nodes, u))


def loss_per_datum(
    model: Model, network: FieldNetwork, prediction: Prediction, samples: Samples
) -> Tensor:
    """Return the loss per datum of a prediction, without the KL divergence of the weights.

    The loss of an ensemble is the mean of its members' losses. Under a load whose output has a unit
    of its own (`FieldNetwork.unit`) errors count in that unit, so that small remainders count as
    large ones do: the network learns from all of them what they have in common.
    """
    reference = samples.displacement
    unit = network.unit(samples.force)
    if unit is not None:
        reference, (mean, std) = reference / unit, prediction
        units = network.of_members(unit)
        prediction = Prediction(mean / units, None if std is None else std / units)
    if network.members > 1:
        reference = reference.repeat(network.members, *[1] * (reference.ndim - 1))
    return model.data_loss(prediction, reference, network)


@torch.no_grad()
@convolutions("float32")
def validate(
    model: Model,
    network: FieldNetwork,
    store: SampleStore,
    count: int,
    reference: Reference,
) -> dict[str, float]:
    """Measure a network on the validation samples, as `FieldNetwork.prepared` returns them.

    Parameters
    ----------
    model : Model
    network : FieldNetwork
    store : SampleStore
    count : int
        Number of samples, the first of the store.
    reference : Reference
        What their errors are compared with.

    Returns
    -------
    dict
        ``validation_loss``; ``validation_error``, the mean absolute error in m over samples, nodes
        and components; ``validation_relative_error``, the mean over the samples of their errors,
        relative to the largest displacement of a node. On an embedded grid also ``grid_error``: the
        part of the grid, an error that a network without an error at the grid points has. The
        result is empty if there are no samples.
    """
    if count == 0:
        return {}
    network.eval()
    loss, error, relative, of_grid = 0.0, 0.0, 0.0, 0.0
    nodal, numbers = reference.nodal, torch.arange(count, device=store.home)
    batches = torch.split(numbers, BATCH)
    for chosen, samples in zip(batches, store.batches(batches), strict=True):
        prediction, weight = network.learned(samples.force), len(samples) / count
        loss += weight * float(loss_per_datum(model, network, prediction, samples))
        mean = prediction.mean.reshape(network.members, -1, *prediction.mean.shape[1:]).mean(dim=0)
        if nodal is None:
            differences = (mean - samples.displacement).abs()
            error += weight * float(differences.mean())
            errors = differences.flatten(1).mean(dim=1) / network.node_fraction
        else:
            errors = nodal.errors(chosen, mean)
            error += weight * float(errors.mean())
            of_grid += weight * float(nodal.errors(chosen, samples.displacement).mean())
        largest = reference.largest[chosen.cpu()].to(errors)
        share = torch.where(largest > 0, errors / largest, 0.0)
        relative += weight * float(share.mean())
    measures = {
        "validation_loss": loss,
        "validation_error": error if nodal is not None else error / network.node_fraction,
        "validation_relative_error": relative,
    }
    return measures if nodal is None else {**measures, "grid_error": of_grid}
