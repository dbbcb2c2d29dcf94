"""How the normalisation of a U-Net bears on the error of fields whose size is that of their load.

The paper's network (three levels, zeros around the grid, ReLU, batches of four) is trained on the
2D beam with each normalisation, for some widths, with a learning rate that falls to zero. All begin
from Glorot's uniform weights, with the mean squared error of unscaled fields. Every run is kept in
the folder `--work`, from which a later start resumes.

    python -m experiments benchmark normalisation DATASET

writes its record and its page.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from typing import Any

from experiments.benchmarks.benchmark import Benchmark, Results
from experiments.benchmarks.further_training import errors, kept
from experiments.framework.report import markdown_table
from shared_schema.common import Parser
from surrogate import Dataset, load, read_dataset, train
from surrogate.runs import run_config

KERAS = {"batch_norm_momentum": 0.01, "batch_norm_epsilon": 1e-3}
NORMS: dict[str, dict[str, Any]] = {
    "none": {"batch_norm": False},
    "channels": {"batch_norm": "channels"},
    "channels, running means of Keras": {"batch_norm": "channels", **KERAS},
    "last axis, running means of Keras": {"batch_norm": "last_axis", **KERAS},
    "groups of 4 channels": {"batch_norm": False, "group_norm": 4},
    "layer": {"batch_norm": False, "group_norm": 1},
}
FIXED = {"levels": 3, "multiplier": 2, "padding": 2, "activation": "relu"}


def measure(options: argparse.Namespace) -> Results:
    """Train all networks, and measure their errors."""
    dataset = read_dataset(options.dataset)
    rows = [
        {"norm": norm, "channels": channels, **trained(options, dataset, norm, channels)}
        for channels in options.channels
        for norm in NORMS
    ]
    return {"case": dataset.manifest.name, "epochs": options.epochs, "rows": rows}


def trained(options: argparse.Namespace, dataset: Dataset, norm: str, channels: int) -> Results:
    """Train a network, unless that has been done."""
    network = {**FIXED, "channels": channels, "initialisation": "glorot", **NORMS[norm]}
    groups = network.get("group_norm", 0)
    if groups > 1:  # of so many channels each
        network["group_norm"] = channels // groups
    name = f"{norm.replace(', ', '-').replace(' ', '-')}-c{channels}-e{options.epochs}"
    content = {
        "name": name,
        "case": dataset.manifest.name,
        "recipe": "custom",
        "likelihood": "deterministic",
        "network": network,
        "training": {
            "epochs": options.epochs,
            "batch_size": 4,
            "optimiser": {"name": "adam", "learning_rate": options.learning_rate},
            "schedule": {"name": "linear"},
            "validation_fraction": 0.0,
        },
        "seed": options.seed,
    }
    folder = options.work / name
    began = time.process_time()
    train(run_config(content, name), dataset, folder, device="cpu")
    return kept(folder, time.process_time() - began) | errors(load(folder), dataset)


def page(results: Results) -> str:
    """Make the page."""
    rows = [
        [
            row["norm"],
            str(row["channels"]),
            *(f"{1e3 * row[f'{name}_error']:.3g}" for name in ("mean", "median", "high")),
            f"{row['seconds']:.0f}",
        ]
        for row in results["rows"]
    ]
    heads = ["normalisation", "channels", "ē, 10⁻³ m", "median", "95 %", "processor time in s"]
    return "\n".join(
        [
            f"U-Nets after {results['epochs']} epochs in batches of four, errors on the test "
            "split. A load has most of its forces zero, and its displacement is about "
            "proportional to what is not: the size of a field is what a network has to tell. A "
            "normalisation with statistics of one sample takes that size away; one with those of "
            "a batch makes it depend on the other loads of the batch.",
            "",
            markdown_table(heads, rows),
        ]
    )


def arguments(parser: Parser) -> None:
    """Add the options."""
    parser.add_argument("dataset", type=Path, help="structured dataset")
    parser.add_argument("--channels", type=int, nargs="+", default=[16, 32], help="widths")
    parser.add_argument("--epochs", type=int, default=60)
    parser.add_argument("--learning-rate", type=float, default=1e-3, help="at the beginning")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--work", type=Path, default=Path("runs/normalisation"))


BENCHMARK = Benchmark(
    name="normalisation",
    title="Normalisation of U-Nets on `{case}`",
    measure=measure,
    page=page,
    arguments=arguments,
    variant=lambda options: "",
)
