"""Samples of the shipped cases by the learner, against those of the factory: rates and differences.

    python -m experiments benchmark sampling

writes its record and its page. Both programs solve the same load cases, one after the other, each
on one thread; a rate is that after the first samples, in which code is compiled. Datasets stay in
the folder `--work`.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

import surrogate
from experiments.benchmarks.benchmark import Results
from experiments.framework.factory import factory
from experiments.framework.machine import ROOT
from experiments.framework.report import markdown_table
from shared_schema import DatasetReader
from shared_schema.common import Parser

TITLE = "Samples without finite-element software"
ABOUT = (
    "`surrogate sample` beside `datagen run`: {samples} load cases of every shipped case, of "
    "which the first {first} do not count for the rates. Differences are those of a sample's worst "
    "node, relative to the largest displacement. Those above 1e-8 are what the absolute tolerance "
    "of the case, 1e-8 N, leaves in the factory's; the learner goes on to 2e-9."
)
FIRST = 8
NAMES = ("number", "displacement", "loaded_nodes", "force", "wall_time")


def compared(case: str, count: int, work: Path) -> Results:
    """Make the samples of a case by both programs, and compare them."""
    body, theirs, ours = (work / case / name for name in ("body", "factory", "learner"))
    make = ["run", case, "--samples", count, "--out", theirs]
    for words in (["body", case, "--out", body], make):
        factory(*words)
    for samples in (count,) if ours.is_dir() else (min(FIRST, count), count):
        surrogate.sample(body, ours, samples)
    arrays = []
    for folder in (theirs, ours):
        found = DatasetReader(folder).joined([f"samples/{name}" for name in NAMES])
        arrays.append({name: found[f"samples/{name}"] for name in NAMES})
    rates = [
        round(float(1 / each["wall_time"][each["number"] >= FIRST].mean()), 2) for each in arrays
    ]
    both = np.intersect1d(arrays[0]["number"], arrays[1]["number"])
    a, b = ({name: of[name][np.isin(of["number"], both)] for name in NAMES} for of in arrays)
    size = np.linalg.norm(a["displacement"], axis=2).max(axis=1)
    moves = size > 0  # the middle of a sweep is no load
    error = np.linalg.norm((a["displacement"] - b["displacement"])[moves], axis=2).max(axis=1)
    error /= size[moves]
    return {
        "case": case,
        "nodes": a["displacement"].shape[1],
        "same_loads": bool(all(np.array_equal(a[n], b[n]) for n in ("loaded_nodes", "force"))),
        "failed": [count - len(each["number"]) for each in arrays],
        "factory_per_second": rates[0],
        "learner_per_second": rates[1],
        "median_difference": float(np.median(error)),
        "largest_difference": float(error.max()),
    }


def measure(options: argparse.Namespace) -> Results:
    """Compare all cases."""
    rows = [compared(case, options.samples, options.work) for case in options.cases.split(",")]
    return {"samples": options.samples, "first": FIRST, "cases": rows}


def page(results: Results) -> str:
    """Make the page."""
    return markdown_table(
        ("case", "nodes", "factory [1/s]", "learner [1/s]", "median difference", "largest"),
        (
            (
                f"`{row['case']}`",
                str(row["nodes"]),
                f"{row['factory_per_second']:.3g}",
                f"{row['learner_per_second']:.3g}",
                f"{row['median_difference']:.0e}",
                f"{row['largest_difference']:.0e}",
            )
            for row in results["cases"]
        ),
    )


def arguments(parser: Parser) -> None:
    """Add the options."""
    cases = ",".join(sorted(p.stem for p in (ROOT / "datagen" / "configs").glob("*.yaml")))
    parser.add_argument("--cases", default=cases, help="names, separated by commas")
    parser.add_argument("--samples", type=int, default=40)
    parser.add_argument("--work", type=Path, default=Path("build/sampling"))
