"""Places that are held: forces found, errors beside the finite elements, times of frames.

Random forces act on one or two nodes that the training loads; the displacement of these nodes in
the finite elements' equilibrium is then held, at once and in frames, in which the places move from
rest to there in a number of equal steps. The forces found and the field of the last frame are
compared with those of the equilibrium, which a correction reaches.

    python -m experiments benchmark grips beam2d_any:200 beam3d_any_reduced:100

writes its record and its page.
"""

from __future__ import annotations

import argparse
import sys
import time
from functools import partial

import numpy as np
from numpy.typing import NDArray

import surrogate
from experiments.benchmarks.benchmark import Results
from experiments.benchmarks.directions import rounded
from experiments.framework.counted_networks import add_counted_networks, over_networks
from experiments.framework.report import table_of
from shared_schema.common import Parser, WorkError

Array = NDArray[np.float64]
NETWORKS = ["beam2d_any:200", "lshape2d_any:200", "beam3d_any_reduced:200"]
FRAMES = 30


def compare(name: str, count: int, seed: int) -> Results:
    """Hold the places of random loads on one body."""
    model = surrogate.load(name)
    x = model.geometry.coordinates
    loadable = np.flatnonzero(model.geometry.loadable & ~model.geometry.clamped)
    limit = np.array(model.description.data.info.force.max_abs)
    off, reactions, fields, predictions = [], [], [], []
    at_once, first, warm = [], [], []
    failed = without = 0
    for number in range(count):
        rng = np.random.default_rng([seed, number])
        nodes = rng.choice(loadable, 1 + number % 2, replace=False)
        force = np.zeros(x.shape)
        force[nodes] = rng.uniform(-limit, limit, (len(nodes), len(limit)))
        try:
            truth = model.correct(force).displacement
        except WorkError:
            without += 1
            continue
        places = [",".join(map(repr, map(float, x[node]))) for node in nodes]
        try:
            grip = surrogate.Grip(model, places)
            grip.move(1e-3 * truth[nodes])  # solves for columns that are kept, and compiles
            grip = surrogate.Grip(model, places)
            began = time.perf_counter()
            alone = grip.move(truth[nodes])
            first.append(time.perf_counter() - began)
            grip = surrogate.Grip(model, places)
            for share in np.linspace(0, 1, FRAMES + 1)[1:]:
                began = time.perf_counter()
                frame = grip.move(share * truth[nodes])
                warm.append(time.perf_counter() - began)
        except WorkError:
            failed += 1
            continue
        predictions.append(alone.predictions)
        held, size = truth[nodes], np.linalg.norm(force[nodes])
        off.append(np.abs(frame.displacement[nodes] - held).max() / np.abs(held).max())
        at_once.append(np.linalg.norm(alone.reactions - force[nodes]) / size)
        reactions.append(np.linalg.norm(frame.reactions - force[nodes]) / size)
        error = np.linalg.norm(frame.displacement - truth, axis=1).max()
        fields.append(error / np.linalg.norm(truth, axis=1).max())
        print(name, number, f"{reactions[-1]:.1e} {fields[-1]:.1e}", file=sys.stderr)
    return {
        "name": name,
        "grips": len(off),
        "failed": failed,
        "without_equilibrium": without,
        "held_off": rounded(np.max(off)),
        "at_once_median": rounded(np.median(at_once)),
        "reaction_median": rounded(np.median(reactions)),
        "reaction_95": rounded(np.quantile(reactions, 0.95)),
        "reaction_within_1_percent": rounded(
            np.sum(np.array(reactions) <= 0.01) / (len(off) + failed)
        ),
        "field_median": rounded(np.median(fields)),
        "predictions": rounded(np.median(predictions)),
        "first_ms": rounded(1e3 * np.median(first)),
        "frame_ms": rounded(1e3 * np.median(warm)),
        "frame_90_ms": rounded(1e3 * np.quantile(warm, 0.9)),
    }


def measure(options: argparse.Namespace) -> Results:
    """Results for some networks."""
    return over_networks(options, partial(compare, seed=options.seed))


def page(results: Results) -> str:
    """Make the page."""
    rows = table_of(
        results["networks"],
        {
            "network": "`{name}`",
            "grips": "{grips}",
            "no forces found": "{failed}",
            "held within": "{held_off:.1e}",
            "reaction, median": "{reaction_median:.2g}",
            "95 %": "{reaction_95:.2g}",
            "within 1 %": "{reaction_within_1_percent:.1%}",
            "field, median": "{field_median:.2g}",
            "from rest [ms]": "{first_ms:.3g}",
            "frame [ms] (90 %)": "{frame_ms:.3g} ({frame_90_ms:.3g})",
        },
    )
    return (
        "Random forces act on one or two nodes; the displacements of these nodes in the finite "
        f"elements' equilibrium are then held, in {FRAMES} frames from rest (seed "
        f"{results['seed']}, {results['threads']} thread). Errors of the last frame: *held within* "
        "is the largest of all grips, relative to the held displacement; *reaction*, of the forces "
        "found to those of the equilibrium; *field*, of the worst node to the largest "
        f"displacement. Times are those of `Grip.move`.\n\n{rows}"
    )


def arguments(parser: Parser) -> None:
    """Add the options."""
    add_counted_networks(parser, NETWORKS, "grips", seed=307)


TITLE = "Places that are held"
