"""How long one prediction takes, beside the finite elements' time for the same load.

Networks of the paper's size and of the `fast` recipes, with random weights, on the meshes of some
nodal datasets; forces in and displacements out are NumPy arrays (1, n_nodes, d). Run by

    OMP_NUM_THREADS=1 .venv-surrogate/bin/python -m tests.benchmarks.prediction_latency \
        data/beam2d/nodal data/lshape2d/nodal data/beam3d/nodal

which writes `docs/results/benchmark-prediction.json` and `docs/benchmark-prediction.md`.
"""

from __future__ import annotations

import argparse
import logging
import sys
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import count, product
from pathlib import Path

import numpy as np
import onnxruntime
import torch
from numpy.typing import NDArray

from shared_schema.common.errors import InputError
from shared_schema.common.nodal_forces import scatter_forces
from shared_schema.dataset_reader import DatasetReader
from shared_schema.grid import Grid
from shared_schema.manifest import ComponentStatistics, Manifest, StructuredInfo
from surrogate.data.geometry import Geometry
from surrogate.inference.export import NodalFunction, export
from surrogate.inference.prediction import PASSES, Surrogate, load
from surrogate.networks.unet import UNetConfig, parameter_count
from surrogate.probabilistic.flipout import VariationalConfig
from surrogate.probabilistic.likelihoods import Likelihood
from surrogate.runs.configuration import RunConfig, read_config
from surrogate.runs.description import DataFingerprint, RunDescription
from surrogate.runs.folder import RunFolder
from surrogate.runs.network import make_network
from surrogate.studies import pass_times, speed_up
from surrogate.studies.timing import median_seconds
from tests.benchmarks.publication import (
    Results,
    command,
    footer,
    machine,
    markdown_table,
    publish,
)

MODULE = "prediction_latency"
RECIPES = ("paper", "fast")
LIKELIHOODS: tuple[Likelihood, ...] = ("deterministic", "variational_bayes")
WAYS = ("PyTorch", "compiled", "ONNX")

Array = NDArray[np.float64]
Work = Callable[[], object]


@dataclass(frozen=True)
class Body:
    """Mesh of a nodal dataset, one of its loads, and how long the solver took.

    Attributes
    ----------
    manifest : Manifest
    geometry : Geometry
    force : array, (1, n_nodes, d)
        In N.
    solving_ms : float
        Median over the samples.
    """

    manifest: Manifest
    geometry: Geometry
    force: Array
    solving_ms: float


def read_body(folder: Path) -> Body:
    """Read what is needed of a nodal dataset."""
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
        return read_config("beam2d-det-fast").network
    return UNetConfig(levels=3 if dimension == 2 else 4)


def untrained(body: Body, recipe: str, likelihood: Likelihood, folder: Path) -> RunFolder:
    """Write a run with random weights, and scales of 1."""
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
    config = RunConfig(
        name=recipe,
        case=body.manifest.name,
        likelihood=likelihood,
        network=shape_of(recipe, dimension),
        variational=VariationalConfig() if likelihood == "variational_bayes" else None,
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
    network = make_network(description, body.geometry)
    run.write_tensors({**network.state_dict(), **body.geometry.tensors()})
    return run


def median_ms(work: Work, repeats: int) -> float:
    """Median wall time of some work after a warm-up, over as many repeats as there is time for."""
    return round(1e3 * median_seconds(work, repeats), 3)


def by_compiling(model: Surrogate, passes: int | None, force: Array) -> Work:
    """Prediction by a network that `torch.compile` has compiled."""
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
    """Prediction by the exported file, on as many threads as PyTorch has."""
    path = run.folder / "model.onnx"
    export(run.folder, "onnx", path, passes)
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = torch.get_num_threads()
    session = onnxruntime.InferenceSession(path, options, providers=["CPUExecutionProvider"])
    single = force.astype(np.float32)
    return lambda: session.run(["displacement"], {"force": single})


def latencies(
    body: Body, run: RunFolder, device: str, ways: tuple[str, ...], repeats: int
) -> Results:
    """Time of one prediction in ms, each way that there is."""
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
        result["PyTorch_ms"] = median_ms(
            lambda: model.predict_distribution(body.force, passes or 1), repeats
        )
        if passes is not None:
            seeds = count(1)
            result["drawing_ms"] = median_ms(
                lambda: model.predict_distribution(body.force, passes, next(seeds)), repeats
            )
    if "compiled" in ways:
        result["compiled_ms"] = median_ms(by_compiling(model, passes, body.force), repeats)
    if "ONNX" in ways and device == "cpu":
        del model  # its passes take gigabytes
        try:
            result["ONNX_ms"] = median_ms(by_onnx(run, passes, body.force), repeats)
        except InputError:  # more passes than a file holds
            result["ONNX_ms"] = None
    return result


def runs(body: Body, recipes: tuple[str, ...], folder: Path) -> Iterator[RunFolder]:
    """Untrained runs of every recipe and likelihood; of variational Bayes in the plane only."""
    for recipe, likelihood in product(recipes, LIKELIHOODS):
        if likelihood == "deterministic" or body.geometry.dimension == 2:
            yield untrained(body, recipe, likelihood, folder / f"{recipe}-{likelihood}")


def papers(case: str) -> tuple[str, ...]:
    """The paper's times in ms: finite elements, U-Net on a CPU and on a GPU; or nothing."""
    paper = speed_up.PAPER.get(case)
    times = (paper.solving, paper.network["CPU"], paper.network["GPU"]) if paper else ("",) * 3
    return tuple(map(str, times))


def table(results: Results) -> str:
    """The results as a page."""

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
        "# How long a prediction takes\n\n"
        "One load in, one displacement field out, both NumPy arrays; medians in ms after a "
        "warm-up. Networks of the paper's\nsize and of the `fast` recipes, with random weights: "
        f"one pass of a deterministic network, or {PASSES} passes of variational\nBayes, whose "
        "drawn weights are kept between predictions (last column: drawn anew each time). "
        "*Compiled* is\n`torch.compile`; *ONNX* is the file of `surrogate export` in ONNX Runtime "
        f"{results['onnxruntime']}, if the passes fit into\none.\n\n"
        f"{rows}\n"
        "## The same by finite elements\n\n"
        "Median time in ms of `datagen`'s solver over the samples of the dataset, on the machine "
        "that made it, and the\npaper's times; it has "
        f"{pass_times.PAPER:g} ms for {PASSES} passes in the plane.\n\n"
        f"{solving}\n{footer(results)}"
    )


def main(arguments: list[str] | None = None) -> None:
    """Time all networks on all bodies, and write the result."""
    arguments = sys.argv[1:] if arguments is None else arguments
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0] if __doc__ else None)
    parser.add_argument("nodal", nargs="+", type=Path, help="nodal datasets")
    parser.add_argument("--recipes", nargs="+", choices=RECIPES, default=RECIPES)
    parser.add_argument("--ways", nargs="+", choices=WAYS, default=WAYS)
    parser.add_argument("--repeats", type=int, default=200)
    options = parser.parse_args(arguments)
    logging.disable(logging.WARNING)
    described = machine(lambda: {"torch": torch.__version__})
    devices = ["cpu", "cuda"] if torch.cuda.is_available() else ["cpu"]
    bodies = [read_body(folder) for folder in options.nodal]
    found: list[Results] = []
    for body in bodies:
        with tempfile.TemporaryDirectory() as folder:
            for run, device in product(runs(body, options.recipes, Path(folder)), devices):
                found.append(latencies(body, run, device, options.ways, options.repeats))
                print(found[-1], file=sys.stderr)
    results: Results = {
        "command": command(MODULE, arguments, ".venv-surrogate"),
        "machine": described,
        "onnxruntime": onnxruntime.__version__,
        "threads": torch.get_num_threads(),
        "solving_ms": {b.manifest.name: round(b.solving_ms, 3) for b in bodies},
        "latencies": found,
    }
    publish("prediction", results, table)


if __name__ == "__main__":
    main()
