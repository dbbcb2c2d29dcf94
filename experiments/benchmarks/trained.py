"""Time of one prediction by the trained networks of the package, beside `datagen`'s in one run.

    python -m experiments benchmark trained

writes its record and its page.
"""

from __future__ import annotations

import argparse
import logging
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from itertools import cycle, islice
from pathlib import Path
from typing import NamedTuple

import numpy as np
import onnxruntime
import torch
from numpy.typing import NDArray

from experiments.benchmarks.benchmark import Results
from experiments.framework.quiet import quiet
from experiments.framework.report import table_of
from experiments.measures.latency import Predict, by_onnx, by_pytorch
from shared_schema import DatasetReader
from shared_schema.common import Parser, scatter_forces
from surrogate import load, shelved
from surrogate.learning.networks import parameter_count
from surrogate.learning.runs import find_run

DATAGEN = Path(".venv-datagen/bin/datagen")
WAYS = ("predict", "PyTorch", "ONNX Runtime", "datagen")
BLOCK = 100

Array = NDArray[np.float64]


def solve(case: str, samples: int, folder: Path) -> tuple[Array, Array]:
    """Solve samples of a case by `datagen`; return forces (N, n_nodes, d) and times in s, (N,)."""
    command = [DATAGEN, "run", case, "--out", folder, "--samples", str(samples)]
    subprocess.run([str(part) for part in command], check=True, capture_output=True)
    reader = DatasetReader(folder, "nodal")
    names = ("samples/loaded_nodes", "samples/force", "samples/wall_time")
    arrays = reader.joined(names)
    nodes, loads, seconds = (arrays[name] for name in names)
    return scatter_forces(nodes, loads, len(reader.body["mesh/coordinates"])), seconds


class Seconds(NamedTuple):
    """Wall time of every prediction, and processor time of each as a mean over a block."""

    wall: list[float]
    processor: list[float]


def seconds_of(ways: dict[str, Predict], forces: Array, repeats: int) -> dict[str, Seconds]:
    """Time predictions of one load after the other, in blocks of one way in turn.

    A block is long against the first predictions, whose weights are not yet in the cache. Before
    them, every way predicts all loads once, which compiles code and solves for the columns of K⁻¹
    that a large body keeps.
    """
    for predict in ways.values():
        for force in forces:
            predict(force)
    taken = {way: Seconds([], []) for way in ways}
    for _ in range(repeats // BLOCK):
        for way, predict in ways.items():
            began_block = time.process_time()
            for force in islice(cycle(forces), BLOCK):
                began = time.perf_counter()
                predict(force)
                taken[way].wall.append(time.perf_counter() - began)
            taken[way].processor.append((time.process_time() - began_block) / BLOCK)
    return taken


def compare(name: str, samples: int, repeats: int) -> Results:
    """Measure one network: half of the solutions before the predictions, half after them."""
    model = load(name)
    in_pytorch = by_pytorch(model)
    case = model.description.run.case
    with tempfile.TemporaryDirectory() as folder:
        forces, before = solve(case, samples, Path(folder, "before"))
        by_file = by_onnx(find_run(name), Path(folder, "model.onnx"))
        ways: dict[str, Callable[[Array], object]] = {
            "predict": model.predict,
            "PyTorch": lambda force: in_pytorch(force[None]),
            "ONNX Runtime": lambda force: by_file(force[None]),
        }
        taken = seconds_of(ways, forces, repeats)
        _, after = solve(case, samples, Path(folder, "after"))
    wall = {way: times.wall for way, times in taken.items()} | {"datagen": [*before, *after]}
    return {
        "name": name,
        "network": model.description.run.architecture,
        "nodes": len(model.geometry.coordinates),
        "parameters": parameter_count(model.network),
        "median_ms": {way: round(1e3 * float(np.median(s)), 4) for way, s in wall.items()},
        "fast_ms": {way: round(1e3 * float(np.quantile(s, 0.1)), 4) for way, s in wall.items()},
        "processor_ms": {
            way: round(1e3 * float(np.median(times.processor)), 4) for way, times in taken.items()
        },
    }


def page(results: Results) -> str:
    """Make the page."""
    rows = table_of(
        results["networks"],
        {
            "network": "`{name}`: {network}",
            "nodes": "{nodes}",
            **{f"`{way}`": f"{{median_ms[{way}]:.3g}}" for way in WAYS},
            "ratio": lambda r: f"{r['median_ms']['datagen'] / r['median_ms']['predict']:.3g}",
        },
    )
    return (
        "One load in, one displacement field out, NumPy arrays both: medians in ms over "
        f"{results['repeats']} loads of the case on {results['threads']} thread. `predict` is that "
        "of `surrogate.load(name)`, `PyTorch` the same network module by module, `ONNX Runtime` "
        f"({results['onnxruntime']}) reads the file of `surrogate export`. `datagen` is the time "
        f"of a solution, over {2 * results['samples']} samples, half of them solved just before "
        "the predictions and half just after. The ratio is that of `datagen` and `predict`."
        f"\n\n{rows}"
    )


@quiet(logging.WARNING)
def measure(options: argparse.Namespace) -> Results:
    """Results for all networks of the package."""
    found: list[Results] = []
    for name in shelved():
        found.append(compare(name, options.samples, options.repeats))
        print(found[-1], file=sys.stderr)
    return {
        "onnxruntime": onnxruntime.__version__,
        "threads": torch.get_num_threads(),
        "samples": options.samples,
        "repeats": options.repeats,
        "networks": found,
    }


def arguments(parser: Parser) -> None:
    """Add the options."""
    parser.add_argument("--samples", type=int, default=20, help="samples to solve, twice")
    parser.add_argument("--repeats", type=int, default=400)


TITLE = "Time of one prediction by the trained networks of the package"
