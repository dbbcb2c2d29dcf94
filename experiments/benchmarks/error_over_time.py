"""Error over the time of a prediction: load series, directions and networks on the same bodies.

    datagen body beam3d_any --out data/beam3d_any/body
    python -m experiments benchmark error-over-time --bodies data/beam3d_any/body:60

writes its record, its page and a figure. Networks beside those of the package are --runs DIR.
"""

from __future__ import annotations

import argparse
import time
import warnings
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter
from numpy.typing import NDArray

import surrogate
from experiments.benchmarks.benchmark import DOCS, Results
from experiments.framework.report import markdown_table
from experiments.framework.timing import timed
from shared_schema.common import Parser
from shared_schema.common.drawing import NETWORK, make_figure, save, styled
from surrogate.figures import CURVES
from surrogate.learning.inference import drawn_loads
from surrogate.learning.measures import node_errors
from surrogate.learning.runs import shelved

NEAR = 5e-3  # of the largest displacement
ORDERS = (1, 2, 3, 4, 5, 6)
TOLERANCES = (5e-3, 1e-3, 1e-4)
FIGURE = DOCS / "figures" / "error-over-time.png"
Array = NDArray[np.float64]
Way = Callable[[Array], Array]


def ways_of_series(
    data: Path, work: Path, orders: Sequence[int], tolerances: Sequence[float]
) -> tuple[dict[str, Way], surrogate.Surrogate]:
    """Load series of some orders, and directions from that of the usual order, with this one."""
    config = surrogate.read_config("series", data=data)
    series = {
        order: surrogate.train(
            config.model_copy(update={"series_order": order}), data, work / str(order)
        )
        for order in orders
    }
    usual = series[config.model_dump()["series_order"]]
    ways: dict[str, Way] = {f"series of order {order}": of.predict for order, of in series.items()}
    for tolerance in tolerances:
        ways[f"directions to {tolerance:g}"] = driven(usual, tolerance)
    return ways, usual


def driven(model: surrogate.Surrogate, tolerance: float) -> Way:
    """Prediction with a tolerance."""
    return lambda force: model.predict(force, tolerance=tolerance)


def compare(ways: dict[str, Way], solving: surrogate.Surrogate, forces: Array) -> Results:
    """Predict loads in all ways in turn, each once before, and solve them."""
    found: dict[str, list[list[float]]] = {name: [] for name in ways}
    for force in forces:
        start = ways[f"directions to {TOLERANCES[-1]:g}"](force)
        truth = solving.correct(force, start).displacement
        largest = float(np.linalg.norm(truth, axis=1).max())
        for name, predict in ways.items():
            predict(force)
            predicted, seconds = timed(partial(predict, force), time.process_time)
            worst = float(node_errors(predicted, truth).max()) / largest
            found[name].append([float(np.abs(predicted - truth).mean()), worst, 1e3 * seconds])
    return {name: summary(*np.array(values).T) for name, values in found.items()}


def summary(error: Array, worst: Array, ms: Array) -> Results:
    """Errors in m, largest ones over the displacement, and times of some loads."""
    return {
        "mean_error_m": float(error.mean()),
        "std_error_m": float(error.std()),
        "median_error_m": float(np.median(error)),
        "within": float((worst <= NEAR).mean()),
        "worst": float(worst.max()),
        "median_ms": float(np.median(ms)),
        "mean_ms": float(ms.mean()),
    }


def measure(options: argparse.Namespace) -> Results:
    """Measure on every body, and draw the figure."""
    warnings.simplefilter("ignore", surrogate.OutsideTrainingWarning)
    warnings.simplefilter("ignore", surrogate.UnreachedToleranceWarning)
    runs = [surrogate.load(run) for run in (*shelved(), *options.runs)]
    networks = [run for run in runs if run.description.run.model != "series"]
    results: Results = {"bodies": {}}
    with TemporaryDirectory() as work:
        for text in options.bodies:
            folder, _, count = text.partition(":")
            place = Path(work) / Path(folder).parent.name
            ways, solving = ways_of_series(Path(folder), place, ORDERS, TOLERANCES)
            case = solving.description.data.case["name"]
            ways |= {
                run.description.run.architecture: run.predict
                for run in networks
                if run.description.data.case["name"] == case
            }
            forces = drawn_loads(solving, int(count or 100), np.random.default_rng(options.seed))
            results["bodies"][case] = {
                "nodes": len(solving.geometry.coordinates),
                "loads": len(forces),
                "ways": compare(ways, solving, forces),
            }
    save(draw(results), FIGURE)
    return results


@styled
def draw(results: Results) -> Figure:
    """Draw mean errors over median times, a panel a body."""
    bodies = results["bodies"]
    figure = make_figure(4.2 * len(bodies), 4.2)
    for axes, (name, body) in zip(
        figure.subplots(1, len(bodies), squeeze=False)[0], bodies.items(), strict=True
    ):
        ways = body["ways"]
        for kind, color, marker in (
            ("series", NETWORK, "o-"),
            ("directions", CURVES[3], "s-"),
        ):
            of_kind = [way for label, way in ways.items() if label.startswith(kind)]
            axes.loglog(
                [way["median_ms"] for way in of_kind],
                [1e3 * way["mean_error_m"] for way in of_kind],
                marker,
                color=color,
                label="load series, order 1 to 6" if kind == "series" else "directions",
            )
        for label, way in ways.items():
            if not label.startswith(("series", "directions")):
                axes.loglog(way["median_ms"], 1e3 * way["mean_error_m"], "^", label=label)
        axes.set_title(f"{name}, {body['nodes']} nodes")
        axes.set_xlabel("time of a prediction [ms]")
        axes.xaxis.set_minor_formatter(NullFormatter())
        times = [way["median_ms"] for way in ways.values()]
        axes.set_xlim(10 ** np.floor(np.log10(min(times))), 10 ** np.ceil(np.log10(max(times))))
        axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.18), fontsize=7)
    figure.axes[0].set_ylabel("mean error [mm]")
    return figure


def page(results: Results) -> str:
    """Make the page."""
    parts = ["![Mean error over the time of a prediction](../figures/error-over-time.png)\n"]
    columns = "prediction", "ē, mm", "within 0.5 %, %", "worst, %", "ms"
    for name, body in results["bodies"].items():
        lines = [
            [
                way,
                f"{1e3 * found['mean_error_m']:.3g}",
                *(f"{100 * found[key]:.3g}" for key in ("within", "worst")),
                f"{found['median_ms']:.3g}",
            ]
            for way, found in body["ways"].items()
        ]
        table = markdown_table(columns, lines)
        parts.append(f"## `{name}`, {body['nodes']} nodes, {body['loads']} loads\n\n{table}")
    return "\n".join(parts)


def arguments(parser: Parser) -> None:
    """Add the options."""
    bodies = [f"data/{name}/body:{n}" for name, n in BODIES.items()]
    parser.add_argument("--bodies", nargs="+", default=bodies, metavar="DIR[:LOADS]")
    parser.add_argument("--runs", nargs="*", default=[], metavar="DIR", help="further networks")
    parser.add_argument("--seed", type=int, default=5309)


BODIES = {"beam2d_any": 400, "lshape2d_any": 400, "beam3d_any": 60}


TITLE = "When a network pays: error over time"
ABOUT = (
    "Loads that no training has seen, drawn from the family of the case, one at a time. Times "
    "are medians of processor time on one thread. The truth is the equilibrium of the finite "
    "elements. Errors of a node are relative to the largest displacement under the load. "
    "U-Nets "
    "are those that came with earlier versions of the package. A network pays where its "
    "point lies left of "
    "the curves."
)
