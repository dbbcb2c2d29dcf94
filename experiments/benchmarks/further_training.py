"""What a network gains by more samples, chosen or random, and by training without solutions.

A network is trained on a few samples of a dataset. Further ones are added in two rounds that each
double their number: random ones, or those that the network's fast certificate calls worst
(`surrogate propose`), out of all others of the dataset. All networks are trained anew, for as many
steps each. From the same first network, `surrogate refine` trains on without solutions, for the
processor time that the training on twice as many random samples takes, and on four times as many.
Errors are those of the test split.

    python -m experiments benchmark further-training DATASET CONFIG

writes its record and its page. Networks are kept in
the folder `--work`, from which a later start resumes.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from experiments.benchmarks.benchmark import Results, case_of
from experiments.framework.report import markdown_table
from experiments.framework.scale import merged
from experiments.measures.solutions import typical_seconds
from shared_schema.common import Parser, write_text
from surrogate import Dataset, Surrogate, load, read_dataset, refine, train
from surrogate.learning.inference import farthest
from surrogate.learning.measures import sample_errors
from surrogate.learning.models import TrainedModel
from surrogate.learning.runs import RunFolder, read_recipe, run_config

Rows = NDArray[np.int64]
ROUNDS = 2
TIMED_STEPS = 30


def measure(options: argparse.Namespace) -> Results:
    """Train all networks, and measure their errors: means over the seeds."""
    dataset = read_dataset(options.dataset)
    solving = typical_seconds(options.dataset.parent / "nodal")
    found = [curves_of(options, dataset, seed, solving) for seed in range(options.seeds)]
    return {
        "case": dataset.manifest.name,
        "config": options.config,
        "seeds": options.seeds,
        "sample_epochs": options.sample_epochs,
        "seconds_per_solution": solving,
        "curves": {
            method: [
                mean_of(points) for points in zip(*(one[method] for one in found), strict=True)
            ]
            for method in found[0]
        },
    }


def mean_of(points: Sequence[Results]) -> Results:
    """Mean of every number over the seeds."""
    names = [name for name in points[0] if name != "folder"]
    return {name: float(np.mean([point[name] for point in points])) for name in names}


def curves_of(
    options: argparse.Namespace, dataset: Dataset, seed: int, solving: float
) -> dict[str, list[Results]]:
    """Train all networks of one seed."""
    rows = np.random.default_rng(seed).permutation(len(dataset.train))
    first, pool = rows[: options.samples], rows[options.samples :][: options.among]
    curves: dict[str, list[Results]] = {}
    start = trained(options, dataset, seed, "start", first)
    for method in ("random", "chosen"):
        curve, known, left, run = [start], first, pool, start
        for _ in range(ROUNDS):
            count, random = len(known), np.random.default_rng([seed, len(known)])
            if method == "random":
                added = random.choice(left, count, replace=False)
            else:
                added = left[worst(load(run["folder"]), dataset, left, count)]
            known, left = np.concatenate([known, added]), np.setdiff1d(left, added)
            run = trained(options, dataset, seed, f"{method}-{len(known)}", known)
            curve.append(run)
        curves[method] = curve
    if isinstance(load(start["folder"]).description.run, TrainedModel):
        curves["without solutions"] = unsolved(options, dataset, seed, curves["random"], solving)
    return curves


def unsolved(
    options: argparse.Namespace,
    dataset: Dataset,
    seed: int,
    random: list[Results],
    solving: float,
) -> list[Results]:
    """Train the first network on without solutions, as long as each larger training took."""
    start, points = random[0], [random[0]]
    step = timed_step(seed, start)
    for run in random[1:]:
        seconds = run["seconds"] + run["samples"] * solving
        steps = max(1, round(seconds / step))
        points.append(refined(options, dataset, seed, start, steps, run["samples"]))
    return points


def trained(
    options: argparse.Namespace, dataset: Dataset, seed: int, name: str, rows: Rows
) -> Results:
    """Train a network on some samples, unless that has been done."""
    content, _ = read_recipe(options.config, dataset)
    training: dict[str, float] = {"validation_fraction": 0.0, "calibration_fraction": 0.0}
    if "epochs" in content["training"]:  # else it is fitted directly
        training["epochs"] = max(1, round(options.sample_epochs / len(rows)))
    change = {"name": name, "recipe": "custom", "seed": seed, "training": training}
    config = run_config(merged(content, change), options.config)
    some = dataset.train.subset(torch.from_numpy(np.sort(rows)))
    folder = options.work / options.config / f"{name}-seed{seed}"
    began = time.process_time()
    train(config, dataclasses.replace(dataset, train_in_memory=some), folder, device="cpu")
    return kept(folder, time.process_time() - began) | {
        "samples": len(rows),
        **errors(load(folder), dataset),
        "folder": folder,
    }


def kept(folder: Path, seconds: float) -> Results:
    """Processor time of a training, which is kept beside its run when it ends."""
    path = folder.with_suffix(".json")
    if not path.is_file():
        write_text(path, json.dumps({"seconds": seconds}))
    return json.loads(path.read_text())


def worst(surrogate: Surrogate, dataset: Dataset, rows: Rows, count: int) -> Rows:
    """Choose places among some rows of the training split, as `surrogate propose` does."""
    force = dataset.nodal_train(torch.from_numpy(rows)).force
    predicted = surrogate.averaged_passes(force).mean
    error = surrogate.fast_estimate(force, predicted)
    error = np.where(np.isfinite(error), error, predicted)
    return farthest(error.reshape(len(rows), -1).astype(np.float32), count)


def refined(
    options: argparse.Namespace,
    dataset: Dataset,
    seed: int,
    start: Results,
    steps: int,
    samples: int,
) -> Results:
    """Train on without solutions, as long as a training on some samples takes."""
    folder = start["folder"].with_name(f"refined-{samples}-seed{seed}")
    began = time.process_time()
    if not RunFolder(folder).is_finished:
        rate = options.learning_rate
        refine(start["folder"], folder, steps=steps, learning_rate=rate, device="cpu")
    return kept(folder, time.process_time() - began) | {
        "steps": steps,
        **errors(load(folder), dataset),
    }


def timed_step(seed: int, start: Results) -> float:
    """Processor time of a step without solutions in s."""
    folder = start["folder"].with_name(f"timed-seed{seed}")
    if not RunFolder(folder).is_finished:
        began = time.process_time()
        refine(start["folder"], folder, steps=TIMED_STEPS, learning_rate=1e-6, device="cpu")
        return float(kept(folder, time.process_time() - began)["seconds"]) / TIMED_STEPS
    return float(kept(folder, 0.0)["seconds"]) / TIMED_STEPS


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
    rows = [
        [
            method,
            f"{point['samples']:g}" if "samples" in point else "–",
            *(f"{1e3 * point[f'{name}_error']:.3g}" for name in ("mean", "median", "high")),
            f"{point['seconds']:.0f}",
        ]
        for number, (method, points) in enumerate(results["curves"].items())
        for point in points[number > 0 :]  # all begin with the same one
    ]
    head = ["samples", "number", "ē, 10⁻³ m", "median", "95 %", "processor time in s"]
    return (
        f"Seeds: {results['seeds']}. Samples that a network sees in its training: "
        f"{results['sample_epochs']}. A solution by `datagen` takes "
        f"{1e3 * results['seconds_per_solution']:.2g} ms.\n\n{markdown_table(head, rows)}"
    )


def variant(options: argparse.Namespace) -> str:
    """Case of the dataset, and kind of the configuration."""
    kind = "-".join(options.config.split("-")[1:-1])
    return f"{case_of(options.dataset)}-{kind}"


def arguments(parser: Parser) -> None:
    """Add the options."""
    parser.add_argument("dataset", type=Path, help="structured dataset, beside its nodal one")
    parser.add_argument("config")
    parser.add_argument("--samples", type=int, default=250, help="of the first network")
    parser.add_argument("--sample-epochs", type=int, default=100_000, help="of every network")
    parser.add_argument("--learning-rate", type=float, default=3e-5, help="without solutions")
    parser.add_argument("--among", type=int, default=4000, help="samples that are chosen from")
    parser.add_argument("--seeds", type=int, default=1, help="repeats")
    parser.add_argument("--work", type=Path, default=Path("runs/further"))


TITLE = "Further training"
ABOUT = (
    "What a network gains by more samples, random or chosen (`surrogate propose`), and by "
    "training without solutions (`surrogate refine`). The latter starts from the first "
    "network, and takes as long as the training on as many random samples and their solution. "
    "Errors are of the test split."
)
PART = "`{case}`, `{config}`"
