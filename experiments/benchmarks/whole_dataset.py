"""Predictions on all test samples of a dataset: load series, directions, and trained networks.

    mpirun -n 2 datagen run beam3d --out data/beam3d/nodal
    datagen structure data/beam3d/nodal --out data/beam3d/structured
    python -m experiments benchmark whole-dataset data/beam3d --runs runs/beam3d-reduced

writes its record and its page. The folder holds the dataset twice: `nodal` and `structured`.
"""

from __future__ import annotations

import argparse
import sys
import time
import warnings
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import NDArray

import surrogate
from experiments.benchmarks.benchmark import Results
from experiments.benchmarks.error_over_time import Way, summary, ways_of_series
from experiments.framework.report import table_of
from experiments.framework.timing import timed
from shared_schema import read_manifest
from shared_schema.common import Parser
from surrogate.learning.measures import node_errors

ORDERS, TOLERANCES = (1, 3, 5), (5e-3,)
TIMED = 50  # samples that are predicted one by one as well
Array = NDArray[np.float64]


def measure(options: argparse.Namespace) -> Results:
    """Predict all test samples in all ways."""
    warnings.simplefilter("ignore", surrogate.OutsideTrainingWarning)
    warnings.simplefilter("ignore", surrogate.UnreachedToleranceWarning)
    folder: Path = options.folder
    dataset, nodal = surrogate.read_dataset(folder / "structured"), read_manifest(folder / "nodal")
    test = dataset.nodal_test
    found: Results = {}
    with TemporaryDirectory() as work:
        ways, _ = ways_of_series(folder / "structured", Path(work), ORDERS, TOLERANCES)
        for name, way in ways.items():
            found[name] = errors(name, way, test.force, test.displacement)
    for run in map(surrogate.load, options.runs):
        name = run.description.run.architecture
        found[name] = errors(name, run.predict, test.force, test.displacement)
    return {
        "case": nodal.name,
        "nodes": len(dataset.geometry.coordinates),
        "samples": nodal.samples,
        "test_samples": len(test.force),
        "gigabytes": {name: size_of(folder / name) for name in ("nodal", "structured")},
        "largest_m": float(np.linalg.norm(test.displacement, axis=2).max()),
        "mean_largest_m": float(np.linalg.norm(test.displacement, axis=2).max(axis=1).mean()),
        "ways": found,
    }


def errors(name: str, predict: Way, forces: Array, truth: Array) -> Results:
    """Errors over all samples, and the processor time of single predictions."""
    seconds = []
    for force in forces[:TIMED]:
        predict(force)
        seconds.append(timed(partial(predict, force), time.process_time)[1])
    predicted = np.concatenate(
        [predict(part) for part in np.array_split(forces, 1 + len(forces) // 64)]
    )
    of_samples = np.abs(predicted - truth).mean(axis=(1, 2))
    worst = node_errors(predicted, truth).max(axis=1) / np.linalg.norm(truth, axis=2).max(axis=1)
    print(name, of_samples.mean(), file=sys.stderr)
    return summary(of_samples, worst, 1e3 * np.array(seconds))


def size_of(folder: Path) -> float:
    """Gigabytes of a folder, two digits."""
    return float(f"{sum(path.stat().st_size for path in folder.iterdir()) / 1e9:.2g}")


def page(results: Results) -> str:
    """Make the page."""
    table = table_of(
        [{"way": way, **found} for way, found in results["ways"].items()],
        {
            "prediction": "{way}",
            "ē (standard deviation), mm": lambda r: (
                f"{1e3 * r['mean_error_m']:.3g} ({1e3 * r['std_error_m']:.3g})"
            ),
            "median, mm": lambda r: f"{1e3 * r['median_error_m']:.3g}",
            "within 0.5 %, %": lambda r: f"{100 * r['within']:.3g}",
            "worst, %": lambda r: f"{100 * r['worst']:.3g}",
            "time, ms": "{median_ms:.3g}",
        },
    )
    size, single = results["gigabytes"], min(TIMED, results["test_samples"])
    return (
        f"`{results['case']}`: {results['nodes']} nodes, {results['samples']} samples, "
        f"{size['nodal']:g} GB of nodal "
        f"fields and {size['structured']:g} GB on the grid. "
        f"The {results['test_samples']} test samples move by {results['mean_largest_m']:.2g} m in "
        f"the mean, {results['largest_m']:.2g} m at most. Errors are mean absolute ones of all "
        "components, those of a node relative to the\nlargest displacement of the sample. Times "
        f"are processor times of one thread, medians over {single} single predictions.\n\n"
        f"{table}"
    )


def arguments(parser: Parser) -> None:
    """Add the options."""
    parser.add_argument("folder", type=Path, metavar="DIR", help="with nodal and structured")
    parser.add_argument("--runs", nargs="*", default=[], metavar="RUN", help="trained networks")


def variant(options: argparse.Namespace) -> str:
    """End of the name of the record."""
    return str(options.folder.name)


TITLE = "All test samples of a dataset"
