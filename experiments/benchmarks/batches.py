"""Loads a second of every trained network of the package: one by one, and in batches.

    python -m experiments benchmark batches

writes its record and its page.
"""

from __future__ import annotations

import argparse
import logging
import sys
from collections.abc import Sequence
from functools import partial

import numpy as np
import torch
from numpy.typing import NDArray

from experiments.benchmarks.benchmark import Benchmark, Results
from experiments.benchmarks.one_load import loads
from experiments.framework.quiet import quiet
from experiments.framework.report import markdown_table
from experiments.framework.timing import timed
from shared_schema.common import Parser
from surrogate import Surrogate, load, shelved

SIZES = (2, 4, 8, 16, 64)  # loads of a batch
Array = NDArray[np.float64]


def one_by_one(model: Surrogate, forces: Array) -> Array:
    """Predict in a loop."""
    return np.stack([model.predict(force) for force in forces])


def compare(
    model: Surrogate, name: str, kind: str, repeats: int, sizes: Sequence[int] = SIZES
) -> Results:
    """Time loops and batches in turn."""
    forces = loads(model, kind, max(sizes))
    single = one_by_one(model, forces)  # compiles, and fills caches
    difference = np.abs(model.predict(forces) - single).max(axis=(1, 2))
    ways = partial(one_by_one, model), model.predict
    seconds = np.empty((repeats, len(sizes), len(ways)))
    for repeat, i, j in np.ndindex(seconds.shape):
        some = forces[: sizes[i]]
        seconds[repeat, i, j] = timed(partial(ways[j], some))[1] / len(some)
    loop, batch = np.median(seconds, axis=0).T
    ratios = np.median(seconds[..., 0] / seconds[..., 1], axis=0)
    found = {
        "name": name,
        "load": kind,
        "loop_loads_per_s": round(float(1 / loop[-1]), 1),
        "batch_loads_per_s": round(float(1 / batch[-1]), 1),
        "ratios": {str(n): round(float(r), 2) for n, r in zip(sizes, ratios, strict=True)},
        "difference": float(f"{(difference / np.abs(single).max(axis=(1, 2))).max():.1e}"),
    }
    print(found, file=sys.stderr)
    return found


def page(results: Results) -> str:
    """Make the page."""
    rows = markdown_table(
        (
            "network",
            "loaded nodes",
            "one by one",
            f"batch of {SIZES[-1]}",
            *(f"ratio of {n}" for n in SIZES),
            "difference",
        ),
        (
            (
                f"`{r['name']}`",
                "1 to 4" if r["load"] == "few" else "all",
                f"{r['loop_loads_per_s']:.4g}",
                f"{r['batch_loads_per_s']:.4g}",
                *(f"{ratio:.2f}" for ratio in r["ratios"].values()),
                f"{r['difference']:.1e}",
            )
            for r in results["batches"]
        ),
    )
    return (
        f"Loads a second of `Surrogate.predict`, by the clock, threads: {results['threads']}; "
        f"medians over {results['repeats']} repeats,\nloops and batches in turn. The ratio is the "
        "time of a loop over that of a batch of so many loads. The difference\nis that between a "
        f"load in a batch of {SIZES[-1]} and alone, relative to its largest displacement.\n\n"
        f"{rows}\n{BOUNDS}"
    )


BOUNDS = """\
A batch reads what its loads share, the factor of the stiffness, the gradients in the cells and the
matrices, once, PyTorch convolves its grids together, and threads share the loads of a series. What
a load computes is the same in both. On the body of `beam3d_any` with its load series of order 5,
loads on few nodes take, in ms of one thread a load, alone and in a batch of 64: four solves with
the factor 14.1 and 2.7, terms at the 26 136 quadrature points 7.2 and 6.2, the least energy 4.0 and
3.8, all 26 and 13.8. Large differences on large bodies are rounding errors of the factor in single
precision, which solves for a load alone as well: on `beam3d_any`, that load alone is 4.4e-6 from
its prediction with a factor in double precision.
"""


@quiet(logging.WARNING)
def measure(options: argparse.Namespace) -> Results:
    """Results for all networks of the package."""
    found = [
        compare(model, name, kind, options.repeats)
        for name in shelved()
        for model in [load(name)]
        for kind in ("few", "all")
    ]
    return {"threads": torch.get_num_threads(), "repeats": options.repeats, "batches": found}


def arguments(parser: Parser) -> None:
    """Add the options."""
    parser.add_argument("--repeats", type=int, default=5)


BENCHMARK = Benchmark(
    name="batches",
    title="Batches of loads",
    measure=measure,
    page=page,
    arguments=arguments,
)
