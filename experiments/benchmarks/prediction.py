"""Time of one prediction, and the finite elements' time for the same load.

Networks of the paper's size and of the `fast` recipes, with random weights, predict on the meshes
of given nodal datasets. Forces and displacements are NumPy arrays (1, n_nodes, d).

    python -m experiments benchmark prediction data/beam2d/nodal data/lshape2d/nodal

writes its record and its page.
"""

from __future__ import annotations

import argparse
import logging
import sys
import tempfile
from collections.abc import Iterator
from functools import partial
from itertools import count, product
from pathlib import Path

import torch

from experiments.benchmarks.benchmark import Results
from experiments.framework.quiet import quiet
from experiments.framework.report import markdown_table, table_of
from experiments.framework.timing import Timing, median_seconds
from experiments.measures.latency import Work, by_compiling, by_onnx, by_pytorch
from experiments.measures.untrained import LIKELIHOODS, RECIPES, Body, read_body, untrained
from experiments.paper.published_numbers import PAPER
from shared_schema.common import InputError, Parser
from surrogate import load
from surrogate.learning.networks import parameter_count
from surrogate.learning.probabilistic import PASSES
from surrogate.learning.runs import RunFolder

WAYS = ("PyTorch", "compiled", "ONNX")


def median_ms(work: Work, repeats: int) -> float:
    """Median wall time of a call in ms, after a warm-up, over at most this many repeats."""
    return round(1e3 * median_seconds(work, Timing(repeats=repeats)), 3)


def latencies(
    body: Body, run: RunFolder, device: str, ways: tuple[str, ...], repeats: int
) -> Results:
    """Measure the time of one prediction in ms, by each of the given ways."""
    model = load(run.folder, device)
    config = model.description.run
    passes = PASSES if model.is_stochastic else None
    result: Results = {
        "case": body.manifest.name,
        "recipe": config.name,
        "likelihood": config.likelihood,
        "device": device,
        "parameters": parameter_count(model.network),
        "passes": passes or 1,
    }
    if "PyTorch" in ways:
        by_way = by_pytorch(model)
        if passes is not None:
            by_way = partial(model.averaged_passes, passes=passes)
        result["PyTorch_ms"] = median_ms(lambda: by_way(body.force), repeats)
        if passes is not None:
            seeds = count(1)
            result["drawing_ms"] = median_ms(
                lambda: model.averaged_passes(body.force, passes, next(seeds)), repeats
            )
    if "compiled" in ways:
        result["compiled_ms"] = median_ms(by_compiling(model, passes, body.force), repeats)
    if "ONNX" in ways and device == "cpu":
        del model  # its passes take gigabytes of memory
        try:
            predict = by_onnx(run.folder, run.folder / "model.onnx", passes)
            result["ONNX_ms"] = median_ms(partial(predict, body.force), repeats)
        except InputError:  # more passes than a file holds
            result["ONNX_ms"] = None
    return result


def runs(body: Body, recipes: tuple[str, ...], folder: Path) -> Iterator[RunFolder]:
    """Yield untrained runs of every recipe and likelihood; variational Bayes in the plane only."""
    for recipe, likelihood in product(recipes, LIKELIHOODS):
        if likelihood == "deterministic" or body.geometry.dimension == 2:
            yield untrained(body, recipe, likelihood, folder / f"{recipe}-{likelihood}")


def papers(case: str) -> tuple[str, ...]:
    """The paper's times in ms: finite elements, U-Net on CPU and on GPU; empty if it has none."""
    paper = PAPER.prediction_times.get(case)
    times = (paper.finite_elements_ms, paper.cpu_ms, paper.gpu_ms) if paper else ("",) * 3
    return tuple(map(str, times))


def page(results: Results) -> str:
    """Make the page."""

    def cell(result: Results, name: str) -> str:
        value = result.get(f"{name}_ms")
        if value is None:
            return ""
        return f"{value:.3g}" if value < 1000 else f"{value:.0f}"

    rows = table_of(
        results["latencies"],
        {
            "case": "`{case}`",
            "network": "{recipe}",
            "passes": "{passes}",
            "parameters": lambda r: f"{r['parameters'] / 1e6:.3g} M",
            "device": "{device}",
            **{way: partial(cell, name=way) for way in WAYS},
            "PyTorch, drawing": partial(cell, name="drawing"),
        },
    )
    solving = markdown_table(
        ("case", "finite elements", "paper: finite elements", "U-Net, CPU", "U-Net, GPU"),
        ((f"`{case}`", f"{ms:.3g}", *papers(case)) for case, ms in results["solving_ms"].items()),
    )
    return (
        "One load in, one displacement field out, NumPy arrays both: medians in ms after a "
        "warm-up. Networks have the paper's size or that of the `fast` recipes, and random "
        "weights. "
        f"Variational Bayes takes {PASSES} passes, whose drawn weights are kept between "
        "predictions (last column: drawn again for each). *Compiled* is by `torch.compile`; *ONNX* "
        f"is the file of `surrogate export` in ONNX Runtime {results['onnxruntime']}, empty if the "
        f"passes do not fit into one file.\n\n{rows}\n"
        "The finite elements: `datagen`'s median over the samples of the dataset on the machine "
        "that made it, and the paper's times in ms. The paper's networks take "
        f"{PAPER.bayesian_prediction.all_passes_ms:g} ms for {PASSES} passes in the plane.\n\n"
        f"{solving}"
    )


@quiet(logging.WARNING)
def measure(options: argparse.Namespace) -> Results:
    """Results for all networks on all bodies."""
    import onnxruntime

    devices = ["cpu", "cuda"] if torch.cuda.is_available() else ["cpu"]
    bodies = [read_body(folder) for folder in options.nodal]
    found: list[Results] = []
    for body in bodies:
        with tempfile.TemporaryDirectory() as folder:
            for run, device in product(runs(body, options.recipes, Path(folder)), devices):
                found.append(latencies(body, run, device, options.ways, options.repeats))
                print(found[-1], file=sys.stderr)
    return {
        "onnxruntime": onnxruntime.__version__,
        "threads": torch.get_num_threads(),
        "solving_ms": {b.manifest.name: round(b.solving_ms, 3) for b in bodies},
        "latencies": found,
    }


def arguments(parser: Parser) -> None:
    """Add the options."""
    parser.add_argument("nodal", nargs="+", type=Path, help="nodal datasets")
    parser.add_argument("--recipes", nargs="+", choices=RECIPES, default=RECIPES)
    parser.add_argument("--ways", nargs="+", choices=WAYS, default=WAYS)
    parser.add_argument("--repeats", type=int, default=200)


TITLE = "Time of one prediction"
