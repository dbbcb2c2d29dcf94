"""Time of one prediction, and the finite elements' time for the same load.

Networks of the paper's size and of the `fast` recipes, with random weights, predict on the meshes
of given nodal datasets. Forces and displacements are NumPy arrays (1, n_nodes, d).

    OMP_NUM_THREADS=1 .venv-surrogate/bin/python -m experiments.benchmarks.prediction_latency \
        data/beam2d/nodal data/lshape2d/nodal data/beam3d/nodal

writes `docs/results/benchmark-prediction.json` and `docs/benchmarks/prediction.md`.
"""

from __future__ import annotations

import argparse
import logging
import sys
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from itertools import count, product
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from experiments.benchmarks.publication import (
    Results,
    argument_parser,
    footer,
    markdown_table,
    run_benchmark,
)
from experiments.framework.timing import Timing, median_seconds
from experiments.paper.published_numbers import PAPER
from shared_schema.common.errors import InputError
from shared_schema.common.nodal_forces import scatter_forces
from shared_schema.dataset_reader import DatasetReader
from shared_schema.grid import Grid
from shared_schema.manifest import ComponentStatistics, Manifest, StructuredInfo
from surrogate.data.geometry import Geometry
from surrogate.inference.export import NodalFunction, export
from surrogate.inference.loading import load
from surrogate.inference.surrogate import Surrogate
from surrogate.networks.unet import UNetConfig, parameter_count
from surrogate.probabilistic.likelihoods import Likelihood
from surrogate.probabilistic.stochastic_passes import PASSES
from surrogate.runs.description import DataFingerprint, RunDescription
from surrogate.runs.folder import RunFolder
from surrogate.runs.run_config import run_config
from tests.surrogate.unet_configs import shipped_unet

MODULE = "prediction_latency"
RECIPES = ("paper", "fast")
LIKELIHOODS: tuple[Likelihood, ...] = ("deterministic", "variational_bayes")
WAYS = ("PyTorch", "compiled", "ONNX")

Array = NDArray[np.float64]
Work = Callable[[], object]


@dataclass(frozen=True)
class Body:
    """Mesh of a nodal dataset, one of its loads, and the solver's time.

    Attributes
    ----------
    manifest : Manifest
    geometry : Geometry
    force : array, (1, n_nodes, d)
        Nodal forces of the first sample, in N.
    solving_ms : float
        Median time of the solver over the samples, in ms.
    """

    manifest: Manifest
    geometry: Geometry
    force: Array
    solving_ms: float


def read_body(folder: Path) -> Body:
    """Read mesh, first load and solving times of a nodal dataset."""
    reader = DatasetReader(folder, "nodal")
    arrays = reader.body
    coordinates = arrays["mesh/coordinates"]
    geometry = Geometry(
        coordinates,
        arrays["mesh/cells"],
        reader.cell_type,
        arrays["mesh/clamped"],
        arrays["mesh/loadable"],
        Grid.from_coordinates(coordinates),
    )
    names = ("samples/loaded_nodes", "samples/force", "samples/wall_time")
    samples = reader.joined(names)
    nodes, loads, wall = (samples[name] for name in names)
    force = scatter_forces(nodes[:1], loads[:1], len(coordinates))
    return Body(reader.manifest, geometry, force, 1e3 * float(np.median(wall)))


def shape_of(recipe: str, dimension: int) -> UNetConfig:
    """U-Net of a recipe."""
    if recipe == "fast":
        return shipped_unet("beam2d-det-fast").network
    return UNetConfig(levels=3 if dimension == 2 else 4)


def untrained(
    body: Body, recipe: str, likelihood: Likelihood, folder: Path, shape: UNetConfig | None = None
) -> RunFolder:
    """Write a run folder with random weights and scales of 1; `shape` replaces the recipe's."""
    dimension = body.geometry.dimension
    zero, one = (0.0,) * dimension, (1.0,) * dimension
    units = ComponentStatistics(mean=zero, std=one, max_abs=one)
    info = StructuredInfo(
        grid_shape=body.geometry.grid.shape,
        train=1,
        test=0,
        split_seed=0,
        force=units,
        displacement=units,
        source_digest="",
    )
    config = run_config(
        {
            "name": recipe,
            "case": body.manifest.name,
            "likelihood": likelihood,
            "network": (shape or shape_of(recipe, dimension)).model_dump(),
            **({"variational": {}} if likelihood == "variational_bayes" else {}),
        }
    )
    data = DataFingerprint(
        case=body.manifest.case,
        digest="",
        dimension=dimension,
        cell_type=body.geometry.cell_type,
        info=info,
    )
    description = RunDescription(run=config, data=data)
    run = RunFolder(folder)
    run.start(description)
    network = description.run.build(body.geometry, description.data.info)
    run.write_tensors({**network.state_dict(), **body.geometry.tensors()})
    return run


def median_ms(work: Work, repeats: int) -> float:
    """Median wall time of a call in ms, after a warm-up, over at most this many repeats."""
    return round(1e3 * median_seconds(work, Timing(repeats=repeats)), 3)


def by_pytorch(model: Surrogate) -> Callable[[Array], object]:
    """Make a function that predicts forces (N, n_nodes, d) with the network in PyTorch."""
    device = model.network.free.device

    @torch.inference_mode()
    def predict(force: Array) -> Array:
        single = torch.from_numpy(force.astype(np.float32)).to(device)
        mean = model.nodal_network(single).mean.mean(dim=0)
        return np.asarray(mean.double().cpu().numpy())

    return predict


def by_compiling(model: Surrogate, passes: int | None, force: Array) -> Work:
    """Make a function that predicts with the network compiled by `torch.compile`."""
    function = NodalFunction(model.nodal_network, passes)
    device = model.network.free.device
    if passes is None:
        model.passes.forget()
    else:
        model.passes.draw(0, range(passes))
    fast = torch.compile(function, mode="reduce-overhead" if device.type == "cuda" else "default")
    single = force.astype(np.float32)

    @torch.no_grad()
    def work() -> Array:
        fields = fast(torch.from_numpy(single).to(device))
        return np.asarray(fields["displacement"].cpu().numpy())

    return work


def by_onnx(run: RunFolder, passes: int | None, force: Array) -> Work:
    """Make a function that predicts with the exported file, on as many threads as PyTorch uses."""
    import onnxruntime

    path = run.folder / "model.onnx"
    export(run.folder, path, format="onnx", passes=passes)
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = torch.get_num_threads()
    session = onnxruntime.InferenceSession(path, options, providers=["CPUExecutionProvider"])
    single = force.astype(np.float32)
    return lambda: session.run(["displacement"], {"force": single})


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
            by_way = partial(model.predict_distribution, passes=passes)
        result["PyTorch_ms"] = median_ms(lambda: by_way(body.force), repeats)
        if passes is not None:
            seeds = count(1)
            result["drawing_ms"] = median_ms(
                lambda: model.predict_distribution(body.force, passes, next(seeds)), repeats
            )
    if "compiled" in ways:
        result["compiled_ms"] = median_ms(by_compiling(model, passes, body.force), repeats)
    if "ONNX" in ways and device == "cpu":
        del model  # its passes take gigabytes of memory
        try:
            result["ONNX_ms"] = median_ms(by_onnx(run, passes, body.force), repeats)
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


def table(results: Results) -> str:
    """Make the page of the results."""

    def cell(result: Results, name: str) -> str:
        value = result.get(f"{name}_ms")
        if value is None:
            return ""
        return f"{value:.3g}" if value < 1000 else f"{value:.0f}"

    rows = markdown_table(
        ("case", "network", "passes", "parameters", "device", *WAYS, "PyTorch, drawing"),
        (
            (
                f"`{r['case']}`",
                r["recipe"],
                str(r["passes"]),
                f"{r['parameters'] / 1e6:.3g} M",
                r["device"],
                *(cell(r, way) for way in (*WAYS, "drawing")),
            )
            for r in results["latencies"]
        ),
    )
    solving = markdown_table(
        ("case", "finite elements", "paper: finite elements", "U-Net, CPU", "U-Net, GPU"),
        ((f"`{case}`", f"{ms:.3g}", *papers(case)) for case, ms in results["solving_ms"].items()),
    )
    return (
        "# Time of one prediction\n\n"
        "Input is one load, output one displacement field, both NumPy arrays; values are medians "
        "in ms after a warm-up.\nNetworks have the paper's size or that of the `fast` recipes, "
        "and random weights. Deterministic networks take one\n"
        f"pass, those of variational Bayes {PASSES}; their drawn weights are kept between "
        "predictions (last column: drawn again for\neach). *Compiled* is by `torch.compile`; "
        "*ONNX* is the file of `surrogate export` in ONNX Runtime "
        f"{results['onnxruntime']},\nempty if the passes do not fit into one file.\n\n"
        f"{rows}\n"
        "## Time of the finite elements\n\n"
        "Median time in ms of `datagen`'s solver over the samples of the dataset, on the machine "
        "that made the dataset,\nand the times of the paper, whose networks take "
        f"{PAPER.bayesian_prediction.all_passes_ms:g} ms for {PASSES} passes in the plane.\n\n"
        f"{solving}\n{footer(results)}"
    )


def main() -> None:
    """Time all networks on all bodies, and write the result."""
    parser = argument_parser(__doc__)
    parser.add_argument("nodal", nargs="+", type=Path, help="nodal datasets")
    parser.add_argument("--recipes", nargs="+", choices=RECIPES, default=RECIPES)
    parser.add_argument("--ways", nargs="+", choices=WAYS, default=WAYS)
    parser.add_argument("--repeats", type=int, default=200)
    run_benchmark("prediction", MODULE, parser, measure, table, program="surrogate")


def measure(options: argparse.Namespace) -> Results:
    """Results for all networks on all bodies."""
    import onnxruntime

    logging.disable(logging.WARNING)
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


if __name__ == "__main__":
    main()
