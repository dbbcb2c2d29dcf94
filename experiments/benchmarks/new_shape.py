"""From the surface of a kidney to its pages and its network: times of the steps, errors.

    OMP_NUM_THREADS=2 python -m experiments benchmark new-shape

writes its record and its page. The command is that of a user, on all cores; a step has taken from
the time of the last file of the step before to that of its own. A first run, on a coarse kidney,
compiles code. The errors are those under fresh loads of the case, of another seed.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

import numpy as np

import surrogate
from experiments.benchmarks.benchmark import Results
from experiments.framework.machine import ROOT
from experiments.framework.report import markdown_table
from shared_schema import DatasetReader
from shared_schema.common import Parser, scatter_forces
from tools.kidney import kidney

TITLE = "A network for a new shape"
ABOUT = (
    "`surrogate touch kidney.stl --poisson-ratio 0.45 --set element=linear --network {samples}`, "
    "from a surface to its page, its load series and a reduced network, on two cores, beside other "
    "programs; code is compiled already. The errors are those of {fresh} fresh loads: single nodes "
    "anywhere on the surface, under forces that move the tip of the linear body by up to a tenth "
    "of its size."
)
STEPS = {  # the last file of each
    "body, load series and their page": "kidney.html",
    "samples": "samples/manifest.json",
    "datagen structure": "grid/manifest.json",
    "network": "network/model.safetensors",
    "errors and bounds": "network/evaluation.json",
    "page of the network": "network.html",
}
PREDICTS = (
    "The network errs by {mean_error:.2%} of the largest displacement in the mean of the nodes "
    "(linear elasticity by {mean_error_of_linear_elasticity:.2%}), by {median_largest_error:.1%} "
    "at the worst node of a load in the median, and takes {prediction_ms:.2f} ms a load after "
    "`prepare('surface')`, {prepare_seconds:.1f} s. What it misses are the dimples about single "
    "loaded nodes; the load series, whose page is the first one, has them."
)
LINEAR = ("--poisson-ratio", "0.45", "--set", "element=linear")
HELD = ("--support", "x<-0.035", "--young-modulus", "5000", *LINEAR, "--no-browser")


def touched(work: Path, size: float, *words: str) -> tuple[float, float]:
    """Run the command in a new folder `kidney`; return when it began and when it ended."""
    shutil.rmtree(work / "kidney", ignore_errors=True)
    programs = (str(ROOT / ".venv-datagen" / "bin"), os.environ["PATH"])
    command = [sys.executable, "-m", "surrogate.command_line", "touch", str(work / "kidney.stl")]
    options = [*HELD, "--size", str(size), "--out", str(work / "kidney"), *words]
    began = time.time()
    environment = {**os.environ, "PATH": os.pathsep.join(programs)}
    subprocess.run([*command, *options], check=True, env=environment)
    return began, time.time()


def measure(options: argparse.Namespace) -> Results:
    """Time the command, and measure its network."""
    options.work.mkdir(parents=True, exist_ok=True)
    kidney(options.work / "kidney.stl")
    touched(options.work, 0.008, "--network", "200")
    words = "--network", str(options.samples)
    began, ended = touched(options.work, options.size, *words)
    made = options.work / "kidney"
    at = [began, *((made / file).stat().st_mtime for file in STEPS.values())]
    shutil.rmtree(options.work / "fresh", ignore_errors=True)
    surrogate.sample(made / "body", options.work / "fresh", options.fresh, seed=1)
    names = ("loaded_nodes", "force", "displacement")
    reader = DatasetReader(options.work / "fresh")
    arrays = reader.joined([f"samples/{name}" for name in names])
    nodes, force, truth = (arrays[f"samples/{name}"] for name in names)
    forces = scatter_forces(nodes, force, truth.shape[1])
    network = surrogate.load(made / "network")
    before = time.perf_counter()
    network.prepare("surface")
    prepared = time.perf_counter() - before
    network.predict(forces[0])
    size, times = np.linalg.norm(truth, axis=2).max(axis=1), []
    predicted = np.empty_like(truth)
    for row, each in enumerate(forces):
        before = time.perf_counter()
        predicted[row] = network.predict(each)
        times.append(time.perf_counter() - before)
    error = np.linalg.norm(predicted - truth, axis=2) / size[:, None]
    linear = network.body.equilibrium.linear_response(forces)
    of_linear = np.linalg.norm(linear - truth, axis=2) / size[:, None]
    return {
        "nodes": truth.shape[1],
        "samples": options.samples,
        "fresh": len(truth),
        "seconds": dict(zip(STEPS, np.diff(at).round(1).tolist(), strict=True)),
        "total_seconds": round(ended - began, 1),
        "mean_error": float(error.mean()),
        "median_largest_error": float(np.median(error.max(axis=1))),
        "mean_error_of_linear_elasticity": float(of_linear.mean()),
        "prepare_seconds": round(prepared, 1),
        "prediction_ms": 1e3 * float(np.median(times)),
    }


def page(results: Results) -> str:
    """Make the page."""
    rows = [(step, f"{seconds:.1f}") for step, seconds in results["seconds"].items()]
    total = (f"**all, of {results['nodes']} nodes**", f"**{results['total_seconds']:.1f}**")
    said = PREDICTS.format_map(results)
    return f"{markdown_table(('step', 'time [s]'), [*rows, total])}\n\n{said}"


def arguments(parser: Parser) -> None:
    """Add the options."""
    parser.add_argument("--samples", type=int, default=500)
    parser.add_argument("--fresh", type=int, default=100)
    parser.add_argument("--size", type=float, default=0.0033, help="of the cells, in m")
    parser.add_argument("--work", type=Path, default=Path("build/new-shape"))
