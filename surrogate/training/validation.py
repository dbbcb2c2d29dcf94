"""The loss per datum of a prediction, and its mean over the validation samples."""

from __future__ import annotations

import torch
from torch import Tensor

from surrogate.data.samples import Samples
from surrogate.device import convolutions
from surrogate.models.model import Model
from surrogate.networks.field_network import FieldNetwork
from surrogate.probabilistic.likelihoods import Prediction
from surrogate.training.sample_store import SampleStore

BATCH = 256


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
    model: Model, network: FieldNetwork, store: SampleStore, count: int
) -> dict[str, float]:
    """Measure a network on the validation samples, as `FieldNetwork.prepared` returns them.

    Returns
    -------
    dict
        ``validation_loss``, and ``validation_error``: the mean absolute error in m over samples,
        nodes and components. The result is empty if there are no samples.
    """
    if count == 0:
        return {}
    network.eval()
    loss, error = 0.0, 0.0
    numbers = torch.arange(count, device=store.home)
    for samples in store.batches(torch.split(numbers, BATCH)):
        prediction, weight = network.learned(samples.force), len(samples) / count
        loss += weight * float(loss_per_datum(model, network, prediction, samples))
        mean = prediction.mean.reshape(network.members, -1, *prediction.mean.shape[1:]).mean(dim=0)
        error += weight * float((mean - samples.displacement).abs().mean())
    return {"validation_loss": loss, "validation_error": error / network.node_fraction}
