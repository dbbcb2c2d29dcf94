"""What a training starts with: its configuration checked against the data, samples and network.

A training that starts from another run begins with its weights and scales instead of random ones,
so that its predictions are the same. Only factors of a recalibration are dropped; they belong to
the finished network.
"""

from __future__ import annotations

import logging
import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import torch

from shared_schema.common.bodies.equilibrium import size_warning
from shared_schema.common.errors import InputError
from surrogate.learning.data.body_check import BodyRecord, require_same_body
from surrogate.learning.data.dataset import Dataset
from surrogate.learning.data.joined_dataset import read_dataset
from surrogate.learning.data.mirror import with_mirror_images
from surrogate.learning.data.samples import Samples
from surrogate.learning.data.samples_on_disk import SamplesOnDisk
from surrogate.learning.inference.loading import load
from surrogate.learning.models.model import Model, TrainedModel
from surrogate.learning.models.network_model import training_memory
from surrogate.learning.networks.field_network import FieldNetwork
from surrogate.learning.runs.config_reader import Data
from surrogate.learning.runs.description import Origin
from surrogate.learning.runs.folder import first_difference
from surrogate.learning.runs.split import TrainingSplit, split_training
from surrogate.learning.training.cuda_graph import can_capture
from surrogate.learning.training.data_parallel import ALONE, Ranks
from surrogate.learning.training.trainer import Trainer
from surrogate.learning.training.training_log import require_tensorboard
from surrogate.learning.training.validation import Reference
from surrogate.runtime.device import ORDER, lay_out, require_device_memory, stream
from surrogate.runtime.tensor_file import tensor_digest

OWN_KEYS = ("name", "case", "recipe", "training", "seed")  # may differ from the other run's
logger = logging.getLogger(__name__)
FEW = 10  # training samples, below which a network predicts little but these
Split = TrainingSplit[Samples | SamplesOnDisk]


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


def require_options(stop_after: int | None, seconds: float, tensorboard: bool) -> None:
    """Raise InputError unless the options of `surrogate.train` have valid values."""
    if stop_after is not None and stop_after < 1:
        raise InputError(f"stop_after {stop_after}: expected an epoch, 1 at least", "stop_after")
    if not seconds > 0:
        raise InputError(f"seconds {seconds:g}: expected more than 0", "seconds")
    if tensorboard:
        require_tensorboard()


def dataset_for(config: Model, dataset: Data) -> Dataset:
    """Return a dataset, or read one; its training samples are where the configuration says.

    Raises
    ------
    InputError
        If the samples of a dataset that is read already are elsewhere, or as `read_dataset`.
    """
    stays_on_disk = isinstance(config, TrainedModel) and config.training.samples_on == "disk"
    if not isinstance(dataset, Dataset):
        folders = [dataset] if isinstance(dataset, str | Path) else dataset
        return read_dataset(*folders, on_disk=stays_on_disk, needs_samples=config.learns)
    if stays_on_disk != isinstance(dataset.training, SamplesOnDisk):
        places = ("on disk", "in memory")
        expected, found = places if stays_on_disk else reversed(places)
        raise InputError(f"config '{config.name}': the samples are {found}, expected {expected}")
    return dataset


def require_a_sample_each(config: Model, processes: int) -> None:
    """Raise InputError if a batch has fewer samples than there are processes."""
    if isinstance(config, TrainedModel) and config.training.batch_size < processes:
        raise InputError(
            f"config '{config.name}': key 'training.batch_size' = {config.training.batch_size}, "
            f"expected {processes} at least, the number of processes"
        )


def split_for(config: Model, dataset: Dataset) -> Split:
    """Split the training samples; InputError unless the configuration can learn from them."""
    if dataset.geometry.shapes is not None:
        config.require_shapes(dataset)
        require_samples_as_they_are(config)
    split = split_training(dataset.training, config)
    config.require_suitable(dataset, split.train)
    if len(split.train) < FEW:
        logger.warning(
            "%d training samples, expected %d at least for a network that predicts other loads",
            len(split.train),
            FEW,
        )
    return split


def require_samples_as_they_are(config: Model) -> None:
    """Raise InputError if a training changes samples, or leaves them on disk."""
    if not isinstance(config, TrainedModel):
        return
    training = config.training
    for key, given in (
        ("mirrors", list(training.mirrors)),
        ("samples_on", "disk" if training.samples_on == "disk" else ""),
    ):
        if given:
            raise InputError(
                f"config '{config.name}': key 'training.{key}' = {given}: expected none for "
                "samples of many shapes"
            )


def warn_of_size(dataset: Dataset) -> None:
    """Log a warning if the displacements of the test split are of an unusual size for the body."""
    displacement = dataset.nodal_test.displacement
    what = f"the largest displacement of the {len(displacement)} test samples"
    if unusual := size_warning(displacement, dataset.geometry.coordinates, what):
        logger.warning(unusual)


def make_trainer(
    config: TrainedModel,
    dataset: Dataset,
    split: Split,
    device: torch.device,
    ranks: Ranks = ALONE,
    start: WarmStart | None = None,
) -> Trainer:
    """Build a network in training: mirrored samples, weights.

    Raises
    ------
    InputError
        If the training takes more memory than the device has, or the body is not symmetric.
    """
    split = with_mirrored_samples(config, dataset, split)
    keys = "keys 'network', 'ensemble', 'training.batch_size'"
    needed = least_memory(config, dataset, len(split.train), ranks.count)
    require_device_memory(needed, f"config '{config.name}': {keys}: training", device)
    network = initial_network(config, dataset, split, start)
    lay_out(network, dataset.geometry.dimension, config.training.precision, device)
    if config.training.cuda_graphs and ranks.is_first and not can_capture(device, ranks.count):
        logger.warning(
            "config '%s': 'training.cuda_graphs' is for one process on cuda, here %d on %s; "
            "training continues without it",
            *(config.name, ranks.count, device.type),
        )
    compared = Reference.of(network, dataset, split.validation, split.validation_rows)
    on_few = None
    if compared.nodal is not None:
        rows = split.train_rows[: len(split.validation)]
        on_few = Reference.of(network, dataset, split.train[: len(rows)], rows)
    return Trainer(config, network, split.train, split.validation, ranks, compared, on_few)


def least_memory(config: TrainedModel, dataset: Dataset, samples: int, processes: int = 1) -> int:
    """Estimate what a training on so many samples takes in each process, in bytes, from below."""
    batch = min(math.ceil(config.training.batch_size / processes), samples)
    return training_memory(config, dataset.geometry, batch)


def with_mirrored_samples(config: TrainedModel, dataset: Dataset, split: Split) -> Split:
    """Add the mirror images of the training samples, if the configuration asks for them."""
    axes, key = config.training.mirrors, f"config '{config.name}': key 'training.mirrors'"
    if not axes:
        return split
    if isinstance(split.train, SamplesOnDisk):
        raise InputError(f"{key} = {list(axes)}: expected none of samples on disk")
    return replace(split, train=with_mirror_images(split.train, dataset.geometry, axes, key))


def initial_network(
    config: Model, dataset: Dataset, split: Split, start: WarmStart | None = None
) -> FieldNetwork:
    """Build the network on the CPU, with all that it takes from the data or from another run."""
    material = dataset.material if config.needs_material else None
    network = config.build_for(dataset.geometry, dataset.info, material, dataset.manifest.case)
    if start is not None:
        start.apply(network)
        return network
    first = split.train
    if isinstance(first, SamplesOnDisk):  # random ones of those on disk
        first = first.some(torch.Generator().manual_seed(stream(config.seed, ORDER)))
    config.start_from_data(network, dataset, first)
    return network
