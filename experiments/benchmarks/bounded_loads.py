"""Fast bounds under loads of eight kinds, most of which a network was not trained on.

Axial forces at the end of a slender body make it buckle; the others have larger forces, or more
loaded nodes. The true error is that to the equilibrium that a correction reaches.

    python -m experiments benchmark bounded-loads beam2d_any lshape2d_any

writes its record and its page. Those of bodies in space have their own:

    python -m experiments benchmark bounded-loads beam3d_any beam3d_any_reduced --loads 50 --seed 47
"""

from __future__ import annotations

import argparse
import warnings
from collections import Counter
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

import surrogate
from experiments.benchmarks.benchmark import Results
from experiments.framework.report import markdown_table
from shared_schema.common import Parser
from surrogate.learning.inference import drawn_loads
from surrogate.learning.measures import node_errors
from surrogate.learning.runs import RunFolder, find_run

REFUSALS = {  # short names, and what the reasons contain
    "inverted": "inverted",
    "unstable": "unstable",
    "near an instability": "near an instability",
    "loaded nodes": "loaded node",
    "force": "force components",
    "resultant": "resultant",
    "displacement": ": displacement",
    "estimated error": ": estimated error",
}
Array = NDArray[np.float64]


def kinds_of_loads(model: surrogate.Surrogate, count: int, seed: int) -> dict[str, Array]:
    """Draw loads of every kind, (count, n_nodes, d) in N each.

    The end is where the first coordinate is largest. Forces are multiples of the largest component
    of the training.
    """
    data, x, rng = model.description.data, model.geometry.coordinates, np.random.default_rng(seed)
    limit, d = max(data.info.force.max_abs), x.shape[1]
    end = np.flatnonzero(np.isclose(x[:, 0], x[:, 0].max()))
    free = np.flatnonzero(~model.geometry.clamped)

    def drawn(one: Callable[[Array], object]) -> Array:
        forces = np.zeros((count, *x.shape))
        for force in forces:
            one(force)
        return forces

    def shared(force: Array, across: float) -> None:
        axial = limit * rng.uniform(1, 40) / len(end)
        force[end, 0] = -axial
        force[end, 1] = axial * rng.uniform(-across, across)

    def at_four(force: Array, least: float, across: float) -> None:
        nodes = rng.choice(end, 4, replace=False)
        force[nodes, 0] = -rng.uniform(least * limit, limit, 4)
        force[nodes, 1:] = rng.uniform(-across * limit, across * limit, (4, d - 1))

    def several(force: Array, fewest: int, most: int, reach: float) -> None:
        nodes = rng.choice(free, rng.integers(fewest, most + 1), replace=False)
        force[nodes] = reach * limit * rng.uniform(-1, 1, (len(nodes), d))

    fewest, most = data.load_numbers
    return {
        "like the training": drawn_loads(model, count, rng),
        "axial, in range, at 4 nodes of the end": drawn(lambda f: at_four(f, 0, 0)),
        "the same, from 0.8 of the range on": drawn(lambda f: at_four(f, 0.8, 0)),
        "axial, in range, and a tenth across": drawn(lambda f: at_four(f, 0, 0.1)),
        "axial, 1 to 40 times the range, over the end": drawn(lambda f: shared(f, 0)),
        "the same, and as much across": drawn(lambda f: shared(f, 1)),
        "1 to 6 times the range": drawn(lambda f: several(f, fewest, most, rng.uniform(1, 6))),
        "at 5 to 19 nodes": drawn(lambda f: several(f, 5, 19, 1)),
    }


def judged(model: surrogate.Surrogate, forces: Array, level: float) -> Results:
    """Bound the errors under some loads, and compare the bounds with the true errors."""
    predicted = model.predict(forces)
    bounds = model.bounds(forces, predicted, level)
    parts: dict[str, list[float]] = {"mean": [], "largest": []}
    for k in np.flatnonzero([reason is None for reason in bounds.reasons]):
        truth = model.correct(forces[k], predicted[k]).displacement
        parts["mean"].append(float(np.abs(predicted[k] - truth).mean() / bounds.mean[k]))
        parts["largest"].append(float(node_errors(predicted[k], truth).max() / bounds.largest[k]))
    refused = Counter(
        next(name for name, part in REFUSALS.items() if part in reason)
        for reason in bounds.reasons
        if reason is not None
    )
    return {
        "loads": len(forces),
        "bounded": len(parts["mean"]),
        "exceeded": {name: sum(part > 1 for part in found) for name, found in parts.items()},
        "largest_part": {name: max(found, default=0.0) for name, found in parts.items()},
        "refused": {name: refused[name] for name in REFUSALS if refused[name]},
    }


def measure(options: argparse.Namespace) -> Results:
    """Judge loads of every kind by every network."""
    warnings.simplefilter("ignore", surrogate.OutsideTrainingWarning)
    networks = {}
    for run in options.runs:
        model = surrogate.load(run)
        loads = kinds_of_loads(model, options.loads, options.seed)
        networks[run] = {
            kind: judged(model, forces, options.level) for kind, forces in loads.items()
        }
    return {"level": options.level, "networks": networks}


def rows(results: Results) -> list[list[str]]:
    """Lines of the table, one for each network and kind of loads, and their sums."""
    lines = []
    for run, kinds in results["networks"].items():
        for kind, one in kinds.items():
            exceeded, part = one["exceeded"], one["largest_part"]
            parts = f"{part['mean']:.2f}, {part['largest']:.2f}" if one["bounded"] else "–"
            counts = [f"{one['bounded']} of {one['loads']}"]
            counts.append(f"{exceeded['mean']}, {exceeded['largest']}")
            lines.append([f"`{run}`", kind, *counts, parts, ""])
        bounded, loads, mean, largest = (
            sum(values)
            for values in zip(
                *((o["bounded"], o["loads"], *o["exceeded"].values()) for o in kinds.values()),
                strict=True,
            )
        )
        refused = sum((Counter(one["refused"]) for one in kinds.values()), Counter())
        reasons = ", ".join(f"{name} {count}" for name, count in refused.most_common())
        counts = [f"{bounded} of {loads}", f"{mean}, {largest}"]
        lines.append([f"`{run}`", "all", *counts, "", reasons])
    return lines


def page(results: Results) -> str:
    """Make the page."""
    head = ["network", "loads", "bounded", "exceeded", "largest error over bound", "refused"]
    return markdown_table(head, rows(results))


def arguments(parser: Parser) -> None:
    """Add the options."""
    parser.add_argument("runs", nargs="+", help="run folders, or networks of the package")
    parser.add_argument("--loads", type=int, default=250, help="of every kind")
    parser.add_argument("--seed", type=int, default=13)
    parser.add_argument("--level", type=float, default=0.95)


def variant(options: argparse.Namespace) -> str:
    """Name the record and page of bodies in space; those of the plane have the benchmark's."""
    runs = [RunFolder(find_run(run)) for run in options.runs]
    return "space" if any(run.description().data.dimension == 3 for run in runs) else ""


TITLE = "Fast bounds under loads of all kinds"
ABOUT = (
    "Fast bounds of probability {level:g}, of the mean error and of the largest error of a "
    "node (in this order), against errors to the corrected displacement. [What is refused]"
    "(../background/certificate.md#bounds-in-real-time) has no bound."
)
