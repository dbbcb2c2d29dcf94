"""How the normalisation of a U-Net bears on the error of fields whose size is that of their load.

The paper's network is trained on the 2D beam with each normalisation at a small width, with a
learning rate that falls to zero, and with the best ones at a larger one. Every run is kept in the
folder `--work`, from which a later start resumes.

    python -m experiments benchmark normalisation DATASET

writes its record and its page.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np

from experiments.benchmarks.benchmark import Results
from experiments.framework.report import markdown_table
from experiments.framework.scale import merged
from shared_schema.common import Parser
from surrogate import Dataset, Surrogate, load, read_dataset, train
from surrogate.learning.measures import sample_errors
from surrogate.learning.runs import read_recipe, run_config

PYTORCH = {"batch_norm_momentum": 0.1, "batch_norm_epsilon": 1e-5}
KERAS = {"batch_norm_momentum": 0.01, "batch_norm_epsilon": 1e-3}
NORMS: dict[str, dict[str, Any]] = {
    "none": {"batch_norm": False, **PYTORCH},
    "channels": {"batch_norm": "channels", **PYTORCH},
    "channels, running means of Keras": {"batch_norm": "channels", **KERAS},
    "last axis, running means of Keras": {"batch_norm": "last_axis", **KERAS},
    "groups of channels": {"batch_norm": False, "group_norm": 4, **PYTORCH},
    "layer": {"batch_norm": False, "group_norm": 1, **PYTORCH},
}


def measure(options: argparse.Namespace) -> Results:
    """Train all networks, and measure their errors."""
    dataset = read_dataset(options.dataset)
    rows = [trained(options, dataset, norm, options.channels) for norm in NORMS]
    best = sorted(rows, key=lambda row: row["mean_error"])[: options.wide]
    rows += [trained(options, dataset, row["norm"], options.wide_channels) for row in best]
    return {"epochs": options.epochs, "learning_rate": options.learning_rate, "rows": rows}


def trained(options: argparse.Namespace, dataset: Dataset, norm: str, channels: int) -> Results:
    """Train a network, unless that has been done, and measure its errors."""
    name = f"{norm.replace(', ', '-').replace(' ', '-')}-{channels}"
    training = {
        "epochs": options.epochs,
        "optimiser": {"learning_rate": options.learning_rate},
        "schedule": {"name": "linear"},
        "validation_fraction": 0.0,
    }
    network = {"channels": channels, "initialisation": "glorot", **NORMS[norm]}
    change = {"name": name, "recipe": "custom", "network": network, "training": training}
    content, source = read_recipe("det-paper", dataset)
    folder = options.work / name
    train(run_config(merged(content, change), source), dataset, folder, device="cpu")
    return {"norm": norm, "channels": channels, **errors(load(folder), dataset)}


def errors(surrogate: Surrogate, dataset: Dataset) -> Results:
    """Mean error, median and 95 % percentile over the test split in m."""
    test = dataset.nodal_test
    error = sample_errors(surrogate.averaged_passes(test.force).mean, test.displacement)
    return {
        "mean_error": float(error.mean()),
        "median_error": float(np.median(error)),
        "high_error": float(np.quantile(error, 0.95)),
    }


def page(results: Results) -> str:
    """Make the page."""
    errors_of = ("mean_error", "median_error", "high_error")
    rows = [
        [row["norm"], str(row["channels"]), *(f"{1e3 * row[name]:.3g}" for name in errors_of)]
        for row in results["rows"]
    ]
    return markdown_table(["normalisation", "channels", "ē, 10⁻³ m", "median", "95 %"], rows)


def arguments(parser: Parser) -> None:
    """Add the options."""
    parser.add_argument("dataset", type=Path, help="structured dataset")
    parser.add_argument("--channels", type=int, default=16, help="width of all networks")
    parser.add_argument(
        "--wide", type=int, default=2, help="how many of the best are trained wider"
    )
    parser.add_argument("--wide-channels", type=int, default=32, help="their width")
    parser.add_argument("--epochs", type=int, default=60)
    parser.add_argument("--learning-rate", type=float, default=1e-3, help="at the beginning")
    parser.add_argument("--work", type=Path, default=Path("runs/normalisation"))


TITLE = "Normalisation"
ABOUT = (
    "The paper's network on the 2D beam, with other normalisations of its convolutions: "
    "{epochs} epochs in batches of four, with a learning rate that falls from "
    "{learning_rate:g} to 0, from Glorot's weights. Errors are of the test split. Most forces "
    "of a load are zero, and its displacement grows with the others: the size of a field is "
    "what the network has to tell. Statistics of a batch make a prediction depend on the other "
    "loads of the batch; those of one sample (groups, layer) do not."
)
