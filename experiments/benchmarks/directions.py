"""Predictions within a tolerance: their errors, their times beside those without, wrong claims.

Fresh loads like those of the training; the true displacement is the equilibrium that a correction
reaches from the driven one, and one more Newton step. Errors are those of the worst node, relative
to the largest displacement. A claim is wrong if directions say that the tolerance is reached and it
is not; a certificate is wrong if its settled estimate is within the tolerance and the error is not.

    python -m experiments benchmark directions beam3d_any:400 finger3d:20

writes its record and its page. Bodies of other materials have a record of their own:

    datagen body beam3d_any --set "material={model: gent, ...}" --out data/materials/beam3d_gent
    surrogate train series --data data/materials/beam3d_gent --out runs/materials/beam3d_gent
    python -m experiments benchmark directions runs/materials/beam3d_gent:25 --rows rows.jsonl

on `beam3d_any` (μ = 178 Pa, K = 833 Pa at rest) and on `breast3d` (286, 1333) with

- yeoh: c10: 89 (143), c20: -2 (-3), c30: 0.2 (0.3)
- gent: shear_modulus: 178 (286), limit: 20
- mooney_rivlin: c10: 65 (105), c01: 24 (38)
- ogden: mu: [140, -50] ([225, -80]), alpha: [1.8, -2]
- holzapfel_gasser_ogden, as fibres: c10: 89 (143), k1: 200 (320), k2: 5, kappa: 0,
  compression: true, fibres: [[1, 1, 0]]
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import surrogate
from experiments.benchmarks.benchmark import Results
from experiments.framework.counted_networks import add_counted_networks, over_networks
from experiments.framework.kept_rows import Row, add_rows_option, kept_rows
from experiments.framework.report import table_of
from experiments.framework.timing import timed
from shared_schema.common import Parser, WorkError
from surrogate.learning.inference import drawn_loads
from surrogate.learning.measures import node_errors
from surrogate.mechanics import Load
from surrogate.mechanics.descent import Aim

Array = NDArray[np.float64]
NETWORKS = ["beam3d_any:400", "finger3d:20", "beam2d_any:800", "lshape2d_any:800"]
TOLERANCES = (5e-3, 1e-3)
ROUNDING = 1e-9  # of the displacement: smaller errors may be rounding errors


def rounded(value: float) -> float:
    """Three digits."""
    return float(f"{value:.3g}")


def judged(model: surrogate.Surrogate, number: int, seed: int) -> Row:
    """Predict one load with and without tolerances, in turn.

    Values are lists over these ways; of loads without an equilibrium there are none.
    """
    geometry = model.geometry
    force = drawn_loads(model, 1, np.random.default_rng([seed, number]))
    load = Load.of_samples(geometry, force)[0]
    work = partial(model.predictor.respond, force[0])
    (plain, last), taken = timed(work, time.process_time)
    driven, seconds, directions, reached = [plain], [taken], [0], [False]
    for tolerance in TOLERANCES:
        aim = Aim(tolerance)
        goes_on = partial(model.body.descend, load, plain, aim, float(last[0]))
        (displacement, descent), more = timed(goes_on, time.process_time)
        driven.append(displacement)
        seconds.append(taken + more)
        directions.append(descent.directions)
        reached.append(bool(descent.reached))
    pressure = None if load.following is None else load.following.amplitudes[0]
    try:
        truth = model.correct(force[0], driven[-1], pressure=pressure).displacement
    except WorkError:
        return {}
    truth = truth - model.certify(force[0], truth, pressure=pressure).error
    size = float(np.linalg.norm(truth, axis=1).max())
    certificates = [model.certify(force[0], u, pressure=pressure) for u in driven]
    return {
        "error": [float(node_errors(u, truth).max() / size) for u in driven],
        "mean_error_m": [float(np.abs(u - truth).mean()) for u in driven],
        "estimate": [float(c.max_error / size) if c.settled else np.inf for c in certificates],
        "seconds": seconds,
        "directions": directions,
        "reached": reached,
    }


def compare(name: str, count: int, seed: int, kept: Path | None = None) -> Results:
    """Compare the ways on the loads of one network."""
    model = surrogate.load(name)
    force = drawn_loads(model, 1, np.random.default_rng([seed, 0]))
    load = Load.of_samples(model.geometry, force)[0]
    model.body.descend(load, model.predict(force[0]), Aim(TOLERANCES[-1]))  # compiles

    def said(number: int) -> Row:
        row = judged(model, number, seed)
        print(name, number, *(f"{error:.1e}" for error in row.get("error", ())), file=sys.stderr)
        return row

    rows = kept_rows(kept, name, seed, count, said)
    found = [row for row in rows if "error" in row]
    error, estimate, seconds, directions, reached, lengths = (
        np.array([row[key] for row in found])
        for key in ("error", "estimate", "seconds", "directions", "reached", "mean_error_m")
    )
    ratios = seconds / seconds[:, :1]
    result: Results = {"name": Path(name).name, "loads": len(found)}
    result["without equilibrium"] = count - len(found)
    result["ways"] = [
        {
            "tolerance": ([None, *TOLERANCES])[way],
            "within": rounded(float((error[:, way] <= TOLERANCES[0]).mean())),
            "worst": rounded(error[:, way].max()),
            "median": rounded(float(np.median(error[:, way]))),
            "mean_error_m": rounded(float(lengths[:, way].mean())),
            "median_time": rounded(float(np.median(ratios[:, way]))),
            "mean_time": rounded(float(seconds[:, way].sum() / seconds[:, 0].sum())),
            "directions": rounded(float(directions[:, way].mean())),
            "none": int((directions[:, way] == 0).sum()) if way else 0,
            "single": int((directions[:, way] == 1).sum()),
            "claims": int(reached[:, way].sum()),
            "wrong": int((reached[:, way] & (error[:, way] > TOLERANCES[way - 1])).sum()),
            **certificates_against(
                error[:, way], estimate[:, way], ([TOLERANCES[0], *TOLERANCES])[way]
            ),
        }
        for way in range(1 + len(TOLERANCES))
    ]
    return result


def certificates_against(error: Array, estimate: Array, tolerance: float) -> Results:
    """Effectivities of full certificates, and those that are wrong; all (N,) over displacements."""
    certified = estimate <= tolerance
    settled = np.isfinite(estimate) & (error > ROUNDING)
    effectivity = estimate[settled] / error[settled]
    return {
        "effectivities": [rounded(float(v)) for v in (effectivity.min(), effectivity.max())]
        if settled.any()
        else [],
        "certified": int(certified.sum()),
        "wrongly_certified": int((certified & (error > tolerance)).sum()),
    }


def page(results: Results) -> str:
    """Make the page: a line for each network, with the ways beside each other."""
    first, *driven = slice(0, 1), slice(1, 2), slice(2, None)

    def of(key: str, form: str, ways: slice = slice(1, None)) -> Callable[[Any], str]:
        return lambda row: ", ".join(form.format(way[key]) for way in row["ways"][ways])

    def share(part: str, whole: str) -> Callable[[Any], str]:
        counted = [part, whole]
        return lambda row: " of ".join(str(sum(w[key] for w in row["ways"])) for key in counted)

    def effectivity(row: Any) -> str:
        found = [value for way in row["ways"] for value in way["effectivities"]]
        return f"{min(found):.4g} to {max(found):.4g}"

    ends = zip(TOLERANCES, driven, strict=True)
    rows = table_of(
        results["networks"],
        {
            "network": "`{name}`",
            "loads": "{loads}",
            f"within {TOLERANCES[0]:.1%}": of("within", "{:.1%}", first),
            "worst": of("worst", "{:.2%}", first),
            **{f"worst to {end:.1%}": of("worst", "{:.2%}", way) for end, way in ends},
            "directions": of("directions", "{:.2g}"),
            "time": of("median_time", "{:.2f}"),
            "wrong claims": share("wrong", "claims"),
            "effectivity": effectivity,
            "certified wrongly": share("wrongly_certified", "certified"),
        },
    )
    return f"Seed {results['seed']}, {results['threads']} thread.\n\n{rows}"


def measure(options: argparse.Namespace) -> Results:
    """Results for some networks."""
    return over_networks(options, partial(compare, seed=options.seed, kept=options.rows))


def arguments(parser: Parser) -> None:
    """Add the options."""
    add_counted_networks(parser, NETWORKS, "loads", seed=211)
    add_rows_option(parser)


def variant(options: argparse.Namespace) -> str:
    """Name the record and page of bodies that do not come with the package."""
    return "" if all("/" not in name for name in options.networks) else "materials"


TITLE = "Directions towards equilibrium"
ABOUT = (
    "Fresh loads like those of the training; of bodies that do not come with the package, five "
    "terms of the load series under the loads of `beam3d_any` and `breast3d`. Errors are those of "
    "the worst node, relative to the largest displacement: without a tolerance, and driven to "
    f"{TOLERANCES[0]:.1%} and {TOLERANCES[1]:.1%}. *Directions* (mean) and *time* (median of the "
    "processor time over that without) are of both tolerances, the rest of all ways. A claim is "
    "wrong if directions say that the tolerance is reached, and the true error is larger. "
    "*Effectivity* is the estimated over the true error of full certificates, of estimates that "
    f"settle and errors above {ROUNDING:g}; *certified* are those whose estimate is within the "
    f"tolerance ({TOLERANCES[0]:.1%} without one)."
)
