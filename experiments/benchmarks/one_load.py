"""Time of one prediction by the one-load backend, part by part, against PyTorch for the same part.

    python -m experiments benchmark one-load

writes its record and its page.
"""

from __future__ import annotations

import argparse
import logging
import sys
from collections.abc import Callable, Iterator
from functools import partial

import numpy as np
import torch
from numpy.typing import NDArray

from experiments.benchmarks.benchmark import Benchmark, Results
from experiments.framework.quiet import quiet
from experiments.framework.report import markdown_table
from experiments.framework.timing import timed
from shared_schema.common import Parser
from surrogate import Surrogate, load, shelved
from surrogate.one_load import InputsByPyTorch, OneLoad, ResponseAlone, in_numpy

LOADS, FEW, LARGE = 20, 4, 1000  # different loads; nodes of few; nodes of a large body
Array = NDArray[np.float64]
Function = Callable[[int], object]  # of the number of the load


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


def parts(model: Surrogate, forces: Array) -> Iterator[tuple[str, Function, Function]]:
    """Yield name, backend and PyTorch of every part."""
    nodal, shape = model.nodal_network, model.geometry.grid.shape
    field = nodal.network
    members = in_numpy(field.network, shape, len(shape))
    before = InputsByPyTorch(nodal)
    if members is None:
        alone, own_loads = ResponseAlone(nodal), np.split(forces, len(forces))
        yield "whole", lambda i: alone.several(own_loads[i]), lambda i: before(own_loads[i])
        return
    one = OneLoad(nodal, members)
    yield "whole", lambda i: one(forces[i]), lambda i: one.by_pytorch(forces[i : i + 1])
    if not isinstance(one.before, InputsByPyTorch) and one.before.known(forces).all():
        own = one.before
        yield (
            "before the network",
            lambda i: own(forces[i : i + 1]),
            lambda i: before(forces[i : i + 1]),
        )
    with torch.inference_mode():
        single = torch.from_numpy(forces.astype(np.float32))
        tensors = [field.scaled(field.inputs_of(nodal.on_grid(f[None]))[0]) for f in single]
    arrays = [np.ascontiguousarray(x.flatten(2)[0].T.numpy()) for x in tensors]
    yield "network", lambda i: members[0](arrays[i]), lambda i: field.network(tensors[i])


@torch.inference_mode()
def compare(model: Surrogate, name: str, kind: str, repeats: int) -> list[Results]:
    """Time all parts of a network, the backend and PyTorch in turn."""
    found: list[Results] = []
    if len(model.geometry.coordinates) > LARGE:
        repeats //= 4
    for part, *ways in parts(model, loads(model, kind)):
        seconds: list[list[float]] = [[], []]
        for i in range(-LOADS, repeats):  # the first of every load compiles and fills caches
            for way, taken in zip(ways, seconds, strict=True):
                taken.append(timed(partial(way, i % LOADS))[1])
        ms = 1e3 * np.array(seconds)[:, LOADS:]
        median, fast = np.median(ms, axis=1), np.quantile(ms, 0.1, axis=1)
        found.append(
            {
                "name": name,
                "part": part,
                "load": kind,
                "median_ms": median.round(4).tolist(),
                "fast_ms": fast.round(4).tolist(),
                "ratio": round(float(median[1] / median[0]), 2),
            }
        )
        print(found[-1], file=sys.stderr)
    return found


def page(results: Results) -> str:
    """Make the page."""
    rows = markdown_table(
        ("network", "part", "loaded nodes", "backend", "PyTorch", "ratio"),
        (
            (
                f"`{r['name']}`",
                r["part"],
                "1 to 4" if r["load"] == "few" else "all",
                *(f"{m:.3g} ({f:.3g})" for m, f in zip(r["median_ms"], r["fast_ms"], strict=True)),
                f"{r['ratio']:.2f}",
            )
            for r in results["parts"]
        ),
    )
    return (
        "A single load is predicted in NumPy and compiled loops (`surrogate.one_load`). Times in "
        f"ms on {results['threads']} thread, the backend and\nPyTorch in turn; medians over "
        f"{results['repeats']} calls (a quarter on large bodies) with {LOADS} different loads, in "
        "parentheses the 10 %\nquantile. Every load is predicted once before. The ratio is that "
        "of the medians.\n\n"
        f"{rows}\n"
        "A load series without a network (`beam2d_any`, `lshape2d_any`, `beam3d_any`) is one part. "
        "On a large body (`beam3d_any`)\nPyTorch and the backend call the same compiled series. A "
        "load on many nodes of an embedded grid (`finger3d`) is left to\nPyTorch.\n\n"
        f"{LEFT_OUT}"
    )


LEFT_OUT = """\
## Left out

Parts that were measured in the same way, `beam3d_any` with a U-Net on its series, and given up since they are not
clearly faster:

| network | part | loaded nodes | backend | PyTorch | ratio |
| --- | --- | --- | --- | --- | --- |
| `beam3d_any` | gradients of the load series on the grid, compiled, with the series | 1 | 91.5 (73.6) | 103 (84.8) | 1.12 |
| `beam3d_any` | the same | all | 109 (95.7) | 137 (122) | 1.26 |
| `finger3d` | embedded grid in NumPy, response by PyTorch | all | 19.8 (10.9) | 17.6 (9.6) | 0.89 |

U-Nets once had their points in blocks by parity, and added up the taps that read the same coarse point. That took
0.124 ms in place of 0.144 on `beam2d_any`, and 10.1 ms in place of 13.2 on `beam3d_any` (10 % quantile: 8.4 and 7.9),
for a hundred lines more.
"""  # noqa: E501


@quiet(logging.WARNING)
def measure(options: argparse.Namespace) -> Results:
    """Results for all networks of the package."""
    found: list[Results] = []
    for name in shelved():
        model = load(name)
        for kind in ("few", "all"):
            found += compare(model, name, kind, options.repeats)
    return {"threads": torch.get_num_threads(), "repeats": options.repeats, "parts": found}


def arguments(parser: Parser) -> None:
    """Add the options."""
    parser.add_argument("--repeats", type=int, default=400)


BENCHMARK = Benchmark(
    name="one-load",
    title="One load without PyTorch, part by part",
    measure=measure,
    page=page,
    arguments=arguments,
)
