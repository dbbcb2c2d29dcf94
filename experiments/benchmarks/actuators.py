"""Actuators of soft robots in modes: what they do, and which values reach a target.

    python -m experiments benchmark actuators

writes its record and its page. Bodies and modes stay in the folder `--work`.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from experiments.benchmarks.benchmark import Results
from experiments.framework.factory import factory
from experiments.framework.report import markdown_table
from shared_schema.common import Parser
from surrogate import Actuation
from surrogate.mechanics import Body

TITLE = "Actuators in modes"
ABOUT = (
    "Bodies under random values of all their actuators, within their limits. Forward: the largest "
    "error of a node over the largest displacement, beside the equilibrium of the finite elements, "
    "for {forward} states. Inverse: the tip's places under {inverse} other random values are the "
    "targets; `datagen solve` of the values that are found says how far from its target the tip "
    "then is, over the length of the body. Times are processor times, in the median and of the "
    "slowest in twenty; code is compiled, and every search begins at rest."
)
WITHIN = 5e-3


def measure(options: argparse.Namespace) -> Results:
    """Measure all cases."""
    cases = [measured(name, options) for name in options.cases.split(",")]
    counts = {"forward": options.forward, "inverse": options.inverse}
    return {**counts, "within": WITHIN, "seed": options.seed, "cases": cases}


def measured(name: str, options: argparse.Namespace) -> dict[str, Any]:
    """Measure one case."""
    work = options.work / name
    path = work / "actuation.safetensors"
    if not (work / "manifest.json").is_file():
        factory("body", name, "--out", work, quiet=True)
    body = Body.read(work)
    if not path.is_file():
        Actuation.fit(body).save(path)
    model, rng = Actuation.read(path, body), np.random.default_rng(options.seed)
    low, high = model.limits({})
    x = body.geometry.coordinates
    along = int(np.argmax(np.ptp(x, axis=0)))
    tip = int(np.argmax(x[:, along]))
    place = ",".join(repr(float(value)) for value in x[tip])
    model.reach({place: x[tip]})  # compiles
    columns: dict[str, list[float]] = {key: [] for key in ("error", "ms", "inverse_ms", "missed")}
    for _ in range(options.forward):
        given = dict(zip(model.names, rng.uniform(low, high), strict=True))
        began = time.process_time()
        state = model.at(given)
        columns["ms"].append(1e3 * (time.process_time() - began))
        exact = model.confirmed(state)
        apart = np.linalg.norm(state.displacement - exact.displacement, axis=1).max()
        columns["error"].append(float(apart) / exact.largest)
    for _ in range(options.inverse):
        given = dict(zip(model.names, rng.uniform(low, high), strict=True))
        target = x[tip] + model.at(given).displacement[tip]
        began = time.process_time()
        found = model.reach({place: target})
        columns["inverse_ms"].append(1e3 * (time.process_time() - began))
        values = [word for key, v in found.given.items() for word in ("--actuate", f"{key}={v!r}")]
        factory("solve", name, *values, "--out", work / "found.npz", quiet=True)
        with np.load(work / "found.npz") as solution:
            reached = x[tip] + solution["displacement"][tip]
        columns["missed"].append(float(np.linalg.norm(reached - target)) / model.size)
    found_ = {key: np.array(values) for key, values in columns.items()}
    return {
        "case": name,
        "nodes": len(x),
        "modes": len(model.reduced.modes),
        "cells": [len(model.sample.cells), len(body.geometry.cells)],
        "forward_within": float((found_["error"] <= WITHIN).mean()),
        "forward_worst": float(found_["error"].max()),
        "forward_ms": percentiles(found_["ms"]),
        "inverse_within": float((found_["missed"] <= WITHIN).mean()),
        "inverse_worst": float(found_["missed"].max()),
        "inverse_ms": percentiles(found_["inverse_ms"]),
    }


def percentiles(values: NDArray[np.float64]) -> list[float]:
    """The median, and the slowest in twenty."""
    return [float(value) for value in np.percentile(values, (50, 95))]


def page(results: Results) -> str:
    """Make the page."""
    return markdown_table(
        (
            "case",
            "nodes",
            "modes, cells",
            f"forward within {results['within']:.1%}, worst",
            "time [ms]",
            f"tip within {results['within']:.1%}, worst",
            "time [ms]",
        ),
        (
            (
                f"`{row['case']}`",
                str(row["nodes"]),
                f"{row['modes']}, {row['cells'][0]} of {row['cells'][1]}",
                f"{row['forward_within']:.1%}, {row['forward_worst']:.2%}",
                "{:.1f}, {:.1f}".format(*row["forward_ms"]),
                f"{row['inverse_within']:.0%}, {row['inverse_worst']:.2%}",
                "{:.0f}, {:.0f}".format(*row["inverse_ms"]),
            )
            for row in results["cases"]
        ),
    )


def arguments(parser: Parser) -> None:
    """Add the options."""
    parser.add_argument("--cases", default="actuator3d,trunk3d", help="separated by commas")
    parser.add_argument("--forward", type=int, default=200, help="states")
    parser.add_argument("--inverse", type=int, default=40, help="targets")
    parser.add_argument("--seed", type=int, default=7)
    parser.add_argument("--work", type=Path, default=Path("build/actuators"))
