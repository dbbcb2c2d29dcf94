"""Scaling of the farm over ranks: samples per second of `datagen run` under mpirun.

Every way of running is timed for a small and a large number of samples, each into a new folder. The
rate is the slope between the two, which separates it from start-up (imports, forms, mesh). The ways
are timed alternately, in several rounds, so that other work on the machine slows all of them; the
ratios are computed in each round.

    python -m experiments benchmark scaling

writes its record and its page.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import yaml
from numpy.typing import NDArray

from datagen.cases import SHIPPED
from experiments.benchmarks.benchmark import Results, stored_record
from experiments.framework.report import table_of
from experiments.framework.timing import timed
from shared_schema.common import Parser, WorkError
from tools.open_mpi import SETTINGS

ENVIRONMENT = os.environ | SETTINGS


@dataclass(frozen=True)
class Way:
    """A way of running: number of ranks, and number of ranks that share a solve."""

    ranks: int
    ranks_per_solve: int = 1

    def words(self, program: list[str]) -> list[str]:
        """Command line of a program that is run in this way."""
        shared = ["--ranks-per-solve", str(self.ranks_per_solve)]
        return ["mpirun", "-n", str(self.ranks), *program, *shared]


def run_program(words: Sequence[str], environment: Mapping[str, str] = ENVIRONMENT) -> str:
    """Run a program; return what it prints.

    Raises
    ------
    WorkError
        If it fails.
    """
    done = subprocess.run(words, env=environment, capture_output=True, text=True, check=False)
    if done.returncode:
        raise WorkError(f"{' '.join(words)}\n{done.stderr}")
    return done.stdout


def run_seconds(
    launch: Callable[[list[str]], list[str]],
    case: Path,
    samples: int,
    environment: Mapping[str, str] = ENVIRONMENT,
) -> float:
    """Wall time in s of one whole `datagen run` into a new folder, launched in some way."""
    with tempfile.TemporaryDirectory() as folder:
        program = [sys.executable, "-m", "datagen.command_line", "run", str(case)]
        program += ["--out", f"{folder}/nodal", "--samples", str(samples)]
        return timed(lambda: run_program(launch(program), environment))[1]


def times_of(
    name: str,
    counts: tuple[int, int],
    parts: int,
    ways: Sequence[Callable[[Path, int], float]],
    rounds: int,
) -> tuple[NDArray[np.float64], int]:
    """Times of a case with both numbers of samples by all ways in turn: (rounds, ways, 2) in s.

    The fewer samples make so many shards at least, whose size is returned as well.
    """
    content = yaml.safe_load((SHIPPED / f"{name}.yaml").read_text())
    shard_size = min(content["dataset"]["shard_size"], max(1, counts[0] // parts))
    content["dataset"]["shard_size"] = shard_size
    with tempfile.TemporaryDirectory() as folder:
        case = Path(folder) / "case.yaml"
        case.write_text(yaml.safe_dump(content))
        times = [[[way(case, n) for n in counts] for way in ways] for _ in range(rounds)]
    return np.array(times), shard_size


def scale(name: str, counts: tuple[int, int], ways: list[Way], rounds: int) -> list[Results]:
    """Measure rates and start-up times of a case by all ways, the first of which is one rank."""
    few, many = counts
    runs = [partial(run_seconds, way.words) for way in ways]
    times, shard_size = times_of(name, counts, max(way.ranks for way in ways), runs, rounds)
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


def page(results: Results) -> str:
    """Make the page."""
    rows = table_of(
        results["scaling"],
        {
            "case": "`{case}`",
            "ranks": "{ranks}",
            "ranks per solve": "{ranks_per_solve}",
            "samples / s": "{samples_per_second:.3g}",
            "start-up": "{start_up_s:.1f} s",
            "speed-up": "**{ratio_to_one_rank:.2f}**",
            "efficiency": lambda r: f"{r['ratio_to_one_rank'] / r['ranks']:.0%}",
        },
    )
    counts = {r["case"]: (*r["samples"], r["shard_size"]) for r in results["scaling"]}
    sizes = "; ".join(
        f"`{name}` {few} and {many} samples in shards of {size}"
        for name, (few, many, size) in counts.items()
    )
    return (
        "`mpirun -n RANKS datagen run` into new folders. All ways of running are timed "
        f"alternately; values are medians of\n{results['rounds']} rounds. Samples per second is "
        f"the slope between two numbers of samples, writing included:\n{sizes}.\nStart-up is the "
        "remaining time: imports, forms, mesh, mpirun. Speed-up is over one rank; ranks per solve "
        f"are\nthose of `--ranks-per-solve`.\n\n{rows}{of_two_nodes()}"
    )


def of_two_nodes() -> str:
    """What `experiments.benchmarks.two_nodes` has found; nothing before it has run."""
    try:
        found = stored_record("two-nodes").findings.numbers["comparison"]
    except FileNotFoundError:
        return ""
    ratios = " and ".join(f"{r['ratio']:.2f} times (`{r['case']}`)" for r in found)
    return (
        f"\nTwo nodes with a rank each reach {ratios} the rate of two ranks on one\nnode, without "
        "options, over TCP ([two nodes](two-nodes.md)).\n"
    )


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


def arguments(parser: Parser) -> None:
    """Add the options."""
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


TITLE = "Scaling of the farm over ranks"
