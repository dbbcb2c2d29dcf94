"""Time of predictions, against the same network in PyTorch on the grid.

    python -m experiments benchmark one-load

writes its record and its page.
"""

from __future__ import annotations

import argparse
import logging
import sys
from collections.abc import Callable
from time import process_time

import numpy as np
import torch
from numpy.typing import NDArray

from experiments.benchmarks.benchmark import Benchmark, Results
from experiments.framework.quiet import quiet
from experiments.framework.report import markdown_table
from shared_schema.common import Parser
from surrogate import Surrogate, load, shelved

LOADS, FEW, LARGE = 20, 4, 1000  # different loads; nodes of few; nodes of a large body
MANY = 16  # loads of a batch
Array = NDArray[np.float64]


def loads(model: Surrogate, kind: str, count: int = LOADS) -> Array:
    """Random loads on 1 to 4 nodes, or on all nodes that may be loaded: (N, n_nodes, d) in N."""
    random, geometry = np.random.default_rng(0), model.geometry
    limit = np.array(model.description.data.info.force.max_abs)
    nodes = np.flatnonzero(geometry.loadable & ~geometry.held.any(axis=1))
    forces = np.zeros((count, *geometry.coordinates.shape))
    for force in forces:
        some = random.integers(1, FEW + 1) if kind == "few" else len(nodes)
        chosen = random.choice(nodes, some, replace=False)
        force[chosen] = random.uniform(-limit, limit, (some, len(limit))) / np.sqrt(some)
    return forces


@torch.inference_mode()
def compare(model: Surrogate, name: str, kind: str, count: int, repeats: int) -> Results:
    """Time predictions of a network under some loads, and those of the same by PyTorch, in turn."""
    predictor, forces = model.predictor, loads(model, kind, max(LOADS, count))
    some = [forces[start : start + count] for start in range(0, len(forces), count)]
    ways: tuple[Callable[[Array], object], ...] = (
        predictor.respond,
        lambda f: predictor.batched.distribution(f, 1, 0),
    )
    for is_slow in (count > 1, len(model.geometry.coordinates) > LARGE):
        repeats = repeats // 4 if is_slow else repeats
    seconds: list[list[float]] = [[], []]
    for i in range(-len(some), repeats):  # the first of every load compiles and fills caches
        for way, taken in zip(ways, seconds, strict=True):
            before = process_time()  # the machine may have other work
            way(some[i % len(some)])
            taken.append(process_time() - before)
    ms = 1e3 * np.array(seconds)[:, len(some) :]
    median, fast = np.median(ms, axis=1), np.quantile(ms, 0.1, axis=1)
    found: Results = {
        "name": name,
        "load": kind,
        "count": count,
        "median_ms": median.round(4).tolist(),
        "fast_ms": fast.round(4).tolist(),
        "ratio": round(float(median[1] / median[0]), 2),
    }
    print(found, file=sys.stderr)
    return found


def page(results: Results) -> str:
    """Make the page."""
    rows = markdown_table(
        ("network", "loaded nodes", "loads", "prediction", "PyTorch", "ratio"),
        (
            (
                f"`{r['name']}`",
                "1 to 4" if r["load"] == "few" else "all",
                str(r["count"]),
                *(f"{m:.3g} ({f:.3g})" for m, f in zip(r["median_ms"], r["fast_ms"], strict=True)),
                f"{r['ratio']:.2f}",
            )
            for r in results["parts"]
        ),
    )
    return (
        "Where a prediction needs no gradients, a load series is compiled code on the CPU, and a "
        "reduced network maps forces at\nthe nodes to displacements there "
        "(`surrogate.networks.reduced_at_nodes`); PyTorch computes both on the grid. Processor "
        "times in ms\n"
        f"on {results['threads']} thread, both ways in turn; medians over {results['repeats']} "
        f"calls (a quarter of 16 loads, and on large bodies), in\nparentheses the 10 % quantile. "
        "Every load is predicted once before. The ratio is that of the medians.\n\n"
        f"{rows}\n"
        "On a large body (`beam3d_any`) both ways call the same compiled series.\n\n"
        f"{LEFT_OUT}"
    )


LEFT_OUT = """\
## Left out

No shipped network needs what was measured in the same way and given up: U-Nets in NumPy, and the rows of the modes of
the surface alone (1.17 ms where all nodes of `liver3d` take 0.93).
"""  # noqa: E501


@quiet(logging.WARNING)
def measure(options: argparse.Namespace) -> Results:
    """Results for all networks of the package."""
    found: list[Results] = []
    for name in shelved():
        model = load(name)
        for kind in ("few", "all"):
            found += [compare(model, name, kind, n, options.repeats) for n in (1, MANY)]
    return {"threads": torch.get_num_threads(), "repeats": options.repeats, "parts": found}


def arguments(parser: Parser) -> None:
    """Add the options."""
    parser.add_argument("--repeats", type=int, default=400)


BENCHMARK = Benchmark(
    name="one-load",
    title="Predictions beside PyTorch",
    measure=measure,
    page=page,
    arguments=arguments,
)
