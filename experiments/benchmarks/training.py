"""Training throughput: samples per second of our loop and of a plain PyTorch loop.

The plain loop is that of the tutorials: a DataLoader that collates single samples to batches, the
network without compilation, Adam, and the loss read after every step. Both loops train the same
network on the same samples in batches of 4, by Adam on the mean squared error. Their epochs are
timed alternately, in several rounds, so that other work on the machine slows both; the ratios are
computed in each round.

    python -m experiments benchmark training

writes its record and its page. It needs the
dataset of `make data`.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch.nn import functional
from torch.utils.data import DataLoader, TensorDataset

from experiments.benchmarks.benchmark import Results
from experiments.framework.report import table_of
from experiments.framework.timing import timed
from experiments.measures.untrained import shipped_unet
from shared_schema.common import Parser, Progress
from surrogate import Dataset, read_dataset
from surrogate.learning.data import Samples
from surrogate.learning.models import UNetModel
from surrogate.learning.networks import FieldNetwork, parameter_count
from surrogate.learning.training import Trainer
from surrogate.runtime.device import lay_out

BATCH = 4  # the paper's
NETWORKS = {"paper": "beam2d-det-paper", "fast": "beam2d-det-fast"}
WAYS: dict[str, dict[str, dict[str, Any]]] = {
    "cpu": {"float32": {}},
    "cuda": {
        "float32, CUDA graphs": {"cuda_graphs": True},
        "bfloat16, CUDA graphs": {"cuda_graphs": True, "precision": "bfloat16"},
    },
}
Epoch = Callable[[], object]


def configuration(recipe: str, case: str, changes: dict[str, Any]) -> UNetModel:
    """Configure the network of a recipe with the paper's training, apart from given changes."""
    paper, of_recipe = shipped_unet(NETWORKS["paper"]), shipped_unet(recipe)
    training = paper.training.model_copy(update={"batch_size": BATCH, **changes})
    update = {"case": case, "network": of_recipe.network, "training": training}
    return paper.model_copy(update=update)


def our_epochs(
    config: UNetModel, dataset: Dataset, samples: Samples, device: torch.device
) -> Epoch:
    """Make a function that runs one epoch of our loop."""
    network = config.build(dataset.geometry, dataset.info)
    lay_out(network, dataset.geometry.dimension, config.training.precision, device)
    trainer = Trainer(config, network, samples, samples[:0])
    numbers = iter(range(config.training.epochs))
    silent = Progress(trainer.steps, silent=True)
    return lambda: trainer.train_epoch(next(numbers), silent)


def plain_epochs(
    config: UNetModel, dataset: Dataset, samples: Samples, device: torch.device
) -> Epoch:
    """Make a function that runs one epoch of the plain loop."""
    network = config.build(dataset.geometry, dataset.info).to(device).train()
    optimiser = torch.optim.Adam(network.parameters(), config.training.optimiser.learning_rate)
    loader = DataLoader(
        TensorDataset(samples.force, samples.displacement),
        batch_size=config.training.batch_size,
        shuffle=True,
        pin_memory=device.type == "cuda",
    )
    return lambda: plain_epoch(network, optimiser, loader, device)


def plain_epoch(
    network: FieldNetwork,
    optimiser: torch.optim.Optimizer,
    loader: DataLoader[tuple[torch.Tensor, ...]],
    device: torch.device,
) -> float:
    """Train for one epoch as in the tutorials; return its mean loss."""
    total = 0.0
    for force, displacement in loader:
        force, displacement = force.to(device), displacement.to(device)
        optimiser.zero_grad()
        predicted = network(force).mean
        rms = network.displacement_rms
        loss = functional.mse_loss(predicted / rms, displacement / rms)
        loss.backward()  # type: ignore[no-untyped-call]
        optimiser.step()
        total += loss.item()
    return total / len(loader)


def seconds(epoch: Epoch, device: torch.device) -> float:
    """Wall time of an epoch in s, up to the end of its last kernel."""

    def work() -> None:
        epoch()
        if device.type == "cuda":
            torch.cuda.synchronize(device)

    return timed(work)[1]


def compare(
    name: str, recipe: str, dataset: Dataset, device: torch.device, batches: int, rounds: int
) -> list[Results]:
    """Time the epochs of a network, by the plain loop and by all ways of our loop on a device."""
    case, samples = dataset.manifest.name, dataset.train[: batches * BATCH]
    ways = WAYS[device.type]
    configs = [configuration(recipe, case, changes) for changes in ways.values()]
    epochs = [
        plain_epochs(configs[0], dataset, samples, device),
        *(our_epochs(config, dataset, samples, device) for config in configs),
    ]
    for epoch in epochs:
        seconds(epoch, device)  # warms up
    times = np.array([[seconds(epoch, device) for epoch in epochs] for _ in range(rounds)])
    rates = len(samples) / times  # (rounds, plain and ours)
    return [
        {
            "device": device_name(device),
            "network": name,
            "channels": configs[0].network.channels,
            "parameters": parameter_count(configs[0].build(dataset.geometry, dataset.info)),
            "way": way,
            "plain_samples_per_second": round(float(np.median(rates[:, 0])), 2),
            "samples_per_second": round(float(np.median(rates[:, i])), 2),
            "ratio": round(float(np.median(rates[:, i] / rates[:, 0])), 3),
            "rounds_s": times[:, [0, i]].round(4).tolist(),
        }
        for i, way in enumerate(ways, start=1)
    ]


def device_name(device: torch.device) -> str:
    """Name of a device on the page."""
    if device.type == "cuda":
        return torch.cuda.get_device_name(device)
    threads = torch.get_num_threads()
    return f"CPU, {threads} thread{'s' if threads > 1 else ''}"


def page(results: Results) -> str:
    """Make the page."""
    rows = table_of(
        results["training"],
        {
            "device": "{device}",
            "network": "{network}, c = {channels}",
            "parameters": lambda r: f"{r['parameters'] / 1e6:.2f} M",
            "our loop": "{way}",
            "samples / s": "{samples_per_second:.4g}",
            "plain loop": "{plain_samples_per_second:.4g}",
            "ratio": "**{ratio:.2f}**",
        },
    )
    return (
        "Our training loop compared with a plain PyTorch loop (DataLoader, eager, Adam, float32) "
        f"on `{results['case']}`, with\nbatches of {results['batch']}, {results['batches']} in an "
        f"epoch. Epochs are timed alternately; values are medians of {results['rounds']} rounds.\n"
        "Network, loss and optimiser are the same in both.\n\n"
        f"{rows}"
    )


def measure(options: argparse.Namespace) -> Results:
    """Results for both networks on all devices here."""
    dataset = read_dataset(options.data)
    devices = ["cpu", "cuda"] if torch.cuda.is_available() else ["cpu"]
    return {
        "case": dataset.manifest.name,
        "batch": BATCH,
        "batches": min(options.batches, len(dataset.train) // BATCH),
        "rounds": options.rounds,
        "training": [
            result
            for device in devices
            for name, recipe in NETWORKS.items()
            for result in compare(
                name, recipe, dataset, torch.device(device), options.batches, options.rounds
            )
        ],
    }


def arguments(parser: Parser) -> None:
    """Add the options."""
    parser.add_argument("--data", type=Path, default=Path("data/beam2d/structured"))
    parser.add_argument("--batches", type=int, default=100, help="number of batches of an epoch")
    parser.add_argument("--rounds", type=int, default=10)


TITLE = "Training throughput"
