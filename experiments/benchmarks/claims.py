"""Claims of ``--tolerance`` under loads that mislead estimates of an error.

Bodies of several shapes, materials and elements under the loads of
`experiments.benchmarks.suspect_loads`. A claim counts as broken if directions say that the
tolerance is reached and the displacement is farther than it from the stable equilibrium beside it
(by a settled full certificate, else by Newton's method) and from the one that 4 or 20 load steps
reach. Half of the loads take the early exit of load series, as `Surrogate.predict` does.

    for case in experiments/benchmarks/suspects/*.yaml; do name=$(basename $case .yaml)
        datagen body $case --out data/suspects/$name
        surrogate train series --data data/suspects/$name --out runs/suspects/$name
    done
    python -m experiments benchmark claims runs/suspects/column:1000 --rows build/claims.jsonl

writes its record and its page; with `--rows`, the same command goes on where it was stopped.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import surrogate
from experiments.benchmarks.benchmark import Results
from experiments.benchmarks.directions import rounded
from experiments.benchmarks.suspect_loads import KINDS, SuspectLoads
from experiments.framework.counted_networks import add_counted_networks, over_networks
from experiments.framework.kept_rows import Row, add_rows_option, kept_rows
from experiments.framework.report import table_of
from shared_schema.common import Parser, WorkError
from surrogate.mechanics import Load
from surrogate.mechanics.certify import iterated
from surrogate.mechanics.descent import Aim

Array = NDArray[np.float64]
NETWORKS = ["beam2d_any:1000", "lshape2d_any:1000", "breast3d:100"]
SUSPECTS = Path(__file__).with_name("suspects")
TOLERANCE = 5e-3
STEPS = (4, 20)  # of the load, from rest


def claim(model: surrogate.Surrogate, loads: SuspectLoads, number: int, seed: int) -> Row:
    """Predict one load within the tolerance, and judge what is said of it."""
    kind = KINDS[number % len(KINDS)]
    force = loads.draw(kind, np.random.default_rng([seed, number]))
    begun = time.process_time()
    mean, (last,) = model.predictor.respond(force)
    is_early = number // len(KINDS) % 2 == 0
    aim, last_term = Aim(TOLERANCE), float(last) if is_early else np.inf
    u, found = model.body.descend(Load(force), mean, aim, last_term)
    row: Row = {"kind": kind, "seconds": time.process_time() - begun}
    row |= {"reached": bool(found.reached), "stable": found.stable}
    return row | ({"error": error(model, force, u)} if found.reached else {})


def error(model: surrogate.Surrogate, force: Array, u: Array) -> float:
    """Relative error beside the nearest equilibrium; if that is too far, beside others."""
    certificate = model.certify(force, u)
    size = float(np.linalg.norm(u, axis=1).max())
    least = float(certificate.max_error) / size if certificate.settled else np.inf
    for steps in (0, *STEPS):
        if least > TOLERANCE:
            least = min(least, apart(u, equilibrium(model, force, u, steps)))
    return least


def apart(u: Array, truth: Array | None) -> float:
    """Largest error of a node, relative to the largest displacement; infinite without a truth."""
    if truth is None:
        return np.inf
    lengths = (float(np.linalg.norm(field, axis=1).max()) for field in (u - truth, truth))
    return next(lengths) / next(lengths)


def equilibrium(model: surrogate.Surrogate, force: Array, u: Array, steps: int) -> Array | None:
    """The equilibrium that Newton's method reaches from u, or by load steps from rest."""
    body = model.body.equilibrium
    f = body.forces_at_points(force[None])
    found = np.zeros_like(f) if steps else body.at_points(u[None], f)
    try:
        for step in range(1, max(steps, 1) + 1):
            part = step / max(steps, 1) * f
            found = iterated(body, part, found, "claim").displacement[None]
    except WorkError:
        return None
    return np.asarray(found[0, : len(u)])


def of_network(name: str, count: int, seed: int, kept: Path | None) -> Results:
    """Claims of one network; rows that are kept are not made again."""
    model = surrogate.load(name)
    loads = SuspectLoads(model)

    def judged(number: int) -> Row:
        row = claim(model, loads, number, seed)
        if is_broken(row):
            print("broken:", name, number, json.dumps(row), file=sys.stderr)
        return row

    found = kept_rows(kept, name, seed, count, judged)
    claims = sum(row["reached"] for row in found)
    unstable = sum(not row["stable"] for row in found)
    return {
        "name": Path(name).name,
        **description(model),
        "loads": count,
        "claims": claims,
        "unstable": unstable,
        "undecided": count - claims - unstable,
        "broken": sum(map(is_broken, found)),
        "worst": rounded(max((row["error"] for row in found if row["reached"]), default=0.0)),
        "mean_ms": rounded(1e3 * float(np.mean([row["seconds"] for row in found]))),
        "kinds": {
            kind: [sum(row["reached"] for row in of), len(of), sum(map(is_broken, of))]
            for kind in KINDS
            for of in [[row for row in found if row["kind"] == kind]]
        },
    }


def is_broken(row: Row) -> bool:
    """Whether a load was claimed to be within the tolerance, and is not."""
    return bool(row["reached"] and not row["error"] <= TOLERANCE)


def description(model: surrogate.Surrogate) -> dict[str, str]:
    """Elements and material of the body."""
    data = model.description.data
    materials = data.material if isinstance(data.material, tuple) else (data.material,)
    return {
        "elements": f"{data.case.get('element', 'linear')}, {model.geometry.cell_type}",
        "material": ", ".join(dict.fromkeys(each.model for each in materials)),
    }


def page(results: Results) -> str:
    """Make the page."""
    rows = table_of(
        results["networks"],
        {
            "body": "`{name}`",
            "elements": "{elements}",
            "material": lambda of: of["material"].replace("_", " "),
            "loads": "{loads}",
            "claims": "{claims}",
            "not stable": "{unstable}",
            "undecided": "{undecided}",
            "worst error of a claim": "{worst:.2%}",
            "mean [ms]": "{mean_ms:.3g}",
        },
    )
    kinds = ", ".join(f"{kind} {kinds_claims(results, kind)}" for kind in KINDS)
    return (
        f"{results['loads']} loads that mislead estimates of an error, on "
        f"{len(results['networks'])} bodies, seed {results['seed']} "
        "([`suspect_loads.py`](../../experiments/benchmarks/suspect_loads.py)). A *claim* is a "
        f"prediction that is said to be within {TOLERANCE:.1%} of the largest displacement at "
        "every node. It is *broken* if it is farther than that from the stable equilibrium beside "
        "it, by a full certificate or Newton's method, and from those that 4 and 20 load steps "
        "reach. A load is *not stable* if the state that directions lead to is found to be so, and "
        "*undecided* otherwise: both are exit code 3.\n\n"
        f"**Of {results['claims']} claims {results['broken']} are broken.** Claims of loads by "
        f"kind: {kinds}.\n\n{rows}"
    )


def kinds_claims(results: Results, kind: str) -> str:
    """Claims of the loads of a kind, over all bodies."""
    claims, loads, _ = np.sum([of["kinds"][kind] for of in results["networks"]], axis=0)
    return f"{claims} of {loads}"


def measure(options: argparse.Namespace) -> Results:
    """Results for some networks."""
    found = over_networks(options, partial(of_network, seed=options.seed, kept=options.rows))
    networks = found["networks"]
    total = {key: sum(of[key] for of in networks) for key in ("loads", "claims", "broken")}
    return {**found, **total, "bodies": len(networks)}


def arguments(parser: Parser) -> None:
    """Add the options."""
    add_counted_networks(parser, NETWORKS, "loads", seed=401)
    add_rows_option(parser)


TITLE = "Claims under misleading loads"
