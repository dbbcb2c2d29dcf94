"""A benchmark for others: a family of shapes with a hidden test, and baselines in its card.

    python -m experiments benchmark hidden-test

makes samples of `plate2d_shapes`, trains the baselines, publishes the dataset with their scores
(`datagen publish`) in the folder `--work`, and writes its record and its page. Every sample has a
shape and a load of its own.
"""

from __future__ import annotations

import argparse
import json
import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import surrogate
from experiments.benchmarks import shapes
from experiments.benchmarks.benchmark import Results
from experiments.benchmarks.side_by_side import OTHERS
from experiments.framework.environment import python_with
from experiments.framework.factory import factory
from experiments.framework.machine import ROOT
from experiments.framework.report import markdown_table
from shared_schema import DatasetReader
from shared_schema.common import Parser
from shared_schema.grid import grid_of

Found = tuple[NDArray[np.float64], dict[str, Any]]
TITLE = "A hidden test for others"
ABOUT = (
    "`datagen publish` makes of a dataset [a benchmark with a hidden test]"
    "(../how-to/datasets.md#a-benchmark-with-a-hidden-test). This one has {splits} samples of "
    "`{case}` for training, validation and the hidden test, each of a shape of its own under one "
    "load. The table has the scores of the baselines on the hidden test: the mean error; over the "
    "largest displacement of the sample, the mean error and the worst node, in the mean and at "
    "most; and the share of samples whose worst node is within 0.5 %. The load series is no "
    "network: it needs mesh and material of each shape, and no sample. The networks are trained on "
    "the other two splits, on one core; the last two, {epochs} epochs each, predict at the points "
    "of a {grid} grid, which costs {grid_error:.2%} in the mean. The FNO, by neuraloperator, has "
    "the inputs of the U-Net: the forces, and the parameters as constant channels."
)
CASE = "plate2d_shapes"
PACKAGES = ("torch==2.13.0", "neuraloperator==2.0.0")
RELATIVE = ("relative_mean_error", "worst_node_error", "largest_worst_node_error")
PLAID = ROOT / ".venv-plaid" / "bin" / "python"


def measure(options: argparse.Namespace) -> Results:
    """Train the baselines, publish the dataset with their predictions, and take the scores."""
    work, out = options.work, options.work / "plates"
    row, grid = shapes.trained(CASE, work), work / "grid"
    factory("structure", work / "nodal", "--out", grid)
    epochs = f"training.epochs={options.epochs}"
    for recipe, data, changes in (("series", row, []), ("det-fast", grid, [epochs])):
        config = surrogate.read_config(recipe, changes=changes, data=data)
        surrogate.train(config, data, work / recipe, device="cpu")
    found = {
        "load series": evaluated(work / "series", row),
        "reduced network": evaluated(work / "reduced", row),
        "U-Net": evaluated(work / "det-fast", grid),
        "FNO": fno(grid, work, options.epochs),
    }
    numbers, is_test = columns(row, "number", "is_test")
    words: list[Any] = []
    for name, (predicted, _) in found.items():
        path = work / f"{name.replace(' ', '-')}.npz"
        np.savez(path, number=numbers[is_test], displacement=predicted)
        words += ["--baseline", f"{name}={path}"]
    shutil.rmtree(out, ignore_errors=True)
    words += ["--license", options.license, "--python", PLAID, "--out", out]
    factory("publish", work / "nodal", *words)
    scores = json.loads((out / "huggingface" / "baselines.json").read_text(encoding="utf-8"))
    splits = json.loads((out / "huggingface" / "splits.json").read_text(encoding="utf-8"))
    info = surrogate.read_dataset(grid).info
    assert info.embedding is not None
    return {
        "case": CASE,
        "splits": " + ".join(str(len(splits[key])) for key in ("train", "validation", "test")),
        "epochs": options.epochs,
        "grid": " x ".join(str(count) for count in info.grid_shape),
        "grid_error": info.embedding.mean_error,
        "baselines": [
            {"name": name, **about, **scores[name]} for name, (_, about) in found.items()
        ],
    }


def evaluated(run: Path, data: Path) -> Found:
    """Predict the test samples; return the predictions, and parameters and minutes of the run."""
    evaluation = surrogate.evaluate(run, data, device="cpu")
    content = evaluation.content
    minutes = content["training_seconds"] / 60
    return evaluation.predicted, {"parameters": content["trainable_parameters"], "minutes": minutes}


def fno(grid: Path, work: Path, epochs: int) -> Found:
    """Train by neuraloperator, and do the same, in an environment of its own."""
    python = python_with(work / "venv-neuralop", PACKAGES)
    force, u, p, is_test = columns(grid, "force", "displacement", "parameters", "is_test")
    constant = np.broadcast_to(p[..., None, None], (*p.shape, *u.shape[2:]))
    inputs = np.concatenate([force, (constant - p.mean()) / np.ptp(p)], axis=1)
    given, found = work / "fno-given.npz", work / "fno-found.npz"
    of = {"inputs": inputs[~is_test], "outputs": u[~is_test], "asked": inputs[is_test]}
    np.savez(given, epochs=epochs, **of)
    subprocess.run([python, OTHERS / "fno_by_neuralop.py", given, found], check=True)
    with np.load(found) as file:
        predicted = grid_of(DatasetReader(grid, "structured").body).to_nodes(file["outputs"])
        about = {"parameters": int(file["parameters"]), "minutes": float(file["seconds"]) / 60}
        return predicted, about


def columns(dataset: Path, *names: str) -> list[NDArray[Any]]:
    """Arrays of all samples of a dataset, in ascending order of their number."""
    paths = [f"samples/{name}" for name in names]
    return list(DatasetReader(dataset, "structured").joined(paths).values())


def page(results: Results) -> str:
    """Make the page."""
    return markdown_table(
        (
            *("baseline", "parameters", "training [min]", "mean error [m]", "mean error"),
            *("worst node", "at most", "within 0.5 %"),
        ),
        (
            (
                row["name"],
                str(row["parameters"]),
                f"{row['minutes']:.1f}",
                f"{row['mean_error']:.1e}",
                *(f"{100 * row[key]:.2g} %" for key in RELATIVE),
                f"{row['within_tolerance']:.0%}",
            )
            for row in results["baselines"]
        ),
    )


def arguments(parser: Parser) -> None:
    """Add the options."""
    parser.add_argument("--epochs", type=int, default=40, help="of the networks on a grid")
    parser.add_argument("--license", default="mit", help="of the published dataset")
    parser.add_argument("--work", type=Path, default=Path("build/hidden-test"))
