"""Scaling of the farm over ranks: samples per second of `datagen run` under mpirun.

Every way of running is timed for a small and a large number of samples, each into a new folder. The
rate is the slope between the two, which separates it from start-up (imports, forms, mesh). The ways
are timed alternately, in several rounds, so that other work on the machine slows all of them; the
ratios are computed in each round.

    OMP_NUM_THREADS=1 .venv-datagen/bin/python -m experiments.benchmarks.scaling

writes `docs/results/benchmark-scaling.json` and `docs/benchmarks/scaling.md`.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import yaml

from datagen.cases.case import SHIPPED
from experiments.benchmarks.publication import (
    Results,
    argument_parser,
    footer,
    markdown_table,
    result_path,
    run_benchmark,
)
from tools.open_mpi import SETTINGS

ENVIRONMENT = os.environ | SETTINGS


@dataclass(frozen=True)
class Way:
    """A way of running: number of ranks, and number of ranks that share a solve."""

    ranks: int
    ranks_per_solve: int = 1


def seconds(case: Path, samples: int, way: Way) -> float:
    """Wall time in s of one whole `datagen run` into a new folder."""
    with tempfile.TemporaryDirectory() as folder:
        mpirun = ["mpirun", "-n", str(way.ranks)]
        datagen = [sys.executable, "-m", "datagen.command_line", "run", str(case)]
        options = ["--out", f"{folder}/nodal", "--samples", str(samples)]
        options += ["--ranks-per-solve", str(way.ranks_per_solve)]
        command_line = [*mpirun, *datagen, *options]
        began = time.perf_counter()
        done = subprocess.run(command_line, env=ENVIRONMENT, capture_output=True, text=True)
        elapsed = time.perf_counter() - began
        if done.returncode:
            raise SystemExit(f"{' '.join(command_line)}\n{done.stderr}")
        return elapsed


def scale(name: str, counts: tuple[int, int], ways: list[Way], rounds: int) -> list[Results]:
    """Measure rates and start-up times of a case by all ways, the first of which is one rank."""
    few, many = counts
    content = yaml.safe_load((SHIPPED / f"{name}.yaml").read_text())
    shard_size = min(content["dataset"]["shard_size"], max(1, few // max(w.ranks for w in ways)))
    content["dataset"]["shard_size"] = (
        shard_size  # so that even few samples make a shard for every rank
    )
    with tempfile.TemporaryDirectory() as folder:
        case = Path(folder) / "case.yaml"
        case.write_text(yaml.safe_dump(content))
        times = np.array(
            [[[seconds(case, n, way) for n in counts] for way in ways] for _ in range(rounds)]
        )  # (rounds, ways, 2)
    slopes = (times[..., 1] - times[..., 0]) / (many - few)
    start_up = times[..., 0] - few * slopes
    return [
        {
            "case": name,
            "samples": list(counts),
            "shard_size": shard_size,
            "ranks": way.ranks,
            "ranks_per_solve": way.ranks_per_solve,
            "samples_per_second": round(float(np.median(1 / slopes[:, i])), 3),
            "start_up_s": round(float(np.median(start_up[:, i])), 2),
            "ratio_to_one_rank": round(float(np.median(slopes[:, 0] / slopes[:, i])), 3),
            "rounds_s": times[:, i].round(2).tolist(),
        }
        for i, way in enumerate(ways)
    ]


def table(results: Results) -> str:
    """Make the page of the results."""
    rows = markdown_table(
        ("case", "ranks", "ranks per solve", "samples / s", "start-up", "speed-up", "efficiency"),
        (
            (
                f"`{r['case']}`",
                str(r["ranks"]),
                str(r["ranks_per_solve"]),
                f"{r['samples_per_second']:.3g}",
                f"{r['start_up_s']:.1f} s",
                f"**{r['ratio_to_one_rank']:.2f}**",
                f"{r['ratio_to_one_rank'] / r['ranks']:.0%}",
            )
            for r in results["scaling"]
        ),
    )
    counts = {r["case"]: (*r["samples"], r["shard_size"]) for r in results["scaling"]}
    sizes = "; ".join(
        f"`{name}` {few} and {many} samples in shards of {size}"
        for name, (few, many, size) in counts.items()
    )
    return (
        "# Scaling of the farm over ranks\n\n"
        "`mpirun -n RANKS datagen run` into new folders. All ways of running are timed "
        f"alternately; values are medians of\n{results['rounds']} rounds. Samples per second is "
        f"the slope between two numbers of samples, writing included:\n{sizes}.\nStart-up is the "
        "remaining time: imports, forms, mesh, mpirun. Speed-up is over one rank; ranks per solve "
        f"are\nthose of `--ranks-per-solve`.\n\n{rows}\n{of_two_nodes()}{footer(results)}"
    )


def of_two_nodes() -> str:
    """What `experiments.benchmarks.two_nodes` has found; nothing before it has run."""
    found = result_path("two-nodes")
    if not found.is_file():
        return ""
    ratios = " and ".join(
        f"{r['ratio']:.2f} times (`{r['case']}`)"
        for r in json.loads(found.read_text())["comparison"]
    )
    return (
        f"Two nodes with a rank each reach {ratios} the rate of two ranks on one\nnode, without "
        "options, over TCP ([two nodes](two-nodes.md)).\n\n"
    )


def main() -> None:
    """Time all ways in two and three dimensions, and write the result."""
    parser = argument_parser(__doc__)
    parser.add_argument(
        "--ranks", type=int, nargs="+", default=[1, 2], help="numbers of ranks; 1 is always timed"
    )
    parser.add_argument("--rounds", type=int, default=3)
    for name, counts in (("beam2d", (2000, 20000)), ("beam3d", (20, 100))):
        parser.add_argument(
            f"--{name}",
            type=int,
            nargs=2,
            default=counts,
            metavar=("FEW", "MANY"),
            help=f"numbers of samples (default: {counts[0]} {counts[1]})",
        )
    run_benchmark("scaling", "scaling", parser, measure, table)


def measure(options: argparse.Namespace) -> Results:
    """Results of all ways in two and three dimensions."""
    ways = [Way(1), *(Way(ranks) for ranks in sorted(set(options.ranks) - {1}))]
    shared = [Way(way.ranks, 2) for way in ways if way.ranks % 2 == 0]
    return {
        "rounds": options.rounds,
        "scaling": [
            *scale("beam2d", tuple(options.beam2d), ways, options.rounds),
            *scale("beam3d", tuple(options.beam3d), ways + shared, options.rounds),
        ],
    }


if __name__ == "__main__":
    main()
