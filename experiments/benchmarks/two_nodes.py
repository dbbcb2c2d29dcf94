"""Two nodes with one rank each against two ranks on one node: samples per second of `datagen run`.

The nodes are network namespaces of this machine (`tools.two_nodes`), so both ways have the same
cores, and differ in their messages: TCP over a virtual cable, or shared memory. As in
`experiments.benchmarks.scaling`, rates are slopes between two numbers of samples, timed
alternately.

    python -m experiments benchmark two-nodes

writes its record and its page, as root.
"""

from __future__ import annotations

import argparse
import tempfile
from functools import partial
from pathlib import Path

import numpy as np

from experiments.benchmarks.benchmark import Results
from experiments.benchmarks.scaling import run_seconds, times_of
from experiments.framework.report import table_of
from shared_schema.common import Parser
from tools.two_nodes import TwoNodes, two_nodes


def compare(name: str, counts: tuple[int, int], rounds: int, nodes: TwoNodes) -> Results:
    """Measure the rates of both ways in turn; the ratio is that of each round."""
    few, many = counts
    ways = [
        partial(run_seconds, lambda program: ["mpirun", "-n", "2", *program]),
        partial(run_seconds, nodes.words, environment=nodes.environment()),
    ]
    times, _ = times_of(name, counts, 4, ways, rounds)
    rates = (many - few) / (times[..., 1] - times[..., 0])
    one_node, two = np.median(rates, axis=0)
    return {
        "case": name,
        "samples": [few, many],
        "one_node_per_second": round(float(one_node), 3),
        "two_nodes_per_second": round(float(two), 3),
        "ratio": round(float(np.median(rates[:, 1] / rates[:, 0])), 3),
        "ratios": [round(float(r), 3) for r in rates[:, 1] / rates[:, 0]],
    }


def page(results: Results) -> str:
    """Make the page."""
    rows = table_of(
        results["comparison"],
        {
            "case": "`{case}`",
            "samples": "{samples[0]} and {samples[1]}",
            "2 ranks on one node": "{one_node_per_second:.3g} / s",
            "2 nodes × 1 rank": "{two_nodes_per_second:.3g} / s",
            "ratio": "**{ratio:.2f}**",
            "of the rounds": lambda r: ", ".join(f"{ratio:.2f}" for ratio in r["ratios"]),
        },
    )
    return (
        "`mpirun --hostfile` over two nodes, which are network namespaces of one machine joined by "
        "a virtual cable\n([`tools/two_nodes.py`](../../tools/two_nodes.py)), without options, "
        "compared with two ranks on one node. Rates are slopes\nbetween two numbers of samples, "
        f"timed alternately; medians of {results['rounds']} rounds, and the ratio of each round.\n"
        f"\n{rows}"
    )


def measure(options: argparse.Namespace) -> Results:
    """Results in two and three dimensions."""
    with tempfile.TemporaryDirectory() as folder, two_nodes(Path(folder)) as nodes:
        return {
            "rounds": options.rounds,
            "comparison": [
                compare("beam2d", (400, 4000), options.rounds, nodes),
                compare("beam3d", (8, 24), options.rounds, nodes),
            ],
        }


def arguments(parser: Parser) -> None:
    """Add the options."""
    parser.add_argument("--rounds", type=int, default=5)


TITLE = "Two nodes"
