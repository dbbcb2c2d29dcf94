"""Identification from markers: errors, coverage of intervals, times, over many trials.

A random force acts on a body, whose equilibrium moves markers at random points of the surface. They
are seen with noise; two are swapped, one is not seen. Four tasks: a force at a known place; one
somewhere on the surface; Young's modulus under a force that is known; and both, a force at a known
place and Young's modulus, under a weight that is known. The equilibrium, by directions, is that of
the body's own mesh, or of another run, with another mesh of the same body.

    python -m experiments benchmark identification beam2d_any:200
    python -m experiments benchmark identification beam2d_any:200 --truth runs/finer

writes its record and its page.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

import surrogate
from experiments.benchmarks.benchmark import Results
from experiments.benchmarks.directions import rounded
from experiments.framework.counted_networks import add_counted_networks, over_networks
from experiments.framework.report import table_of
from experiments.framework.timing import timed
from shared_schema.common import Parser, WorkError

Array = NDArray[np.float64]
NETWORKS = ["beam2d_any:200", "beam3d_any_reduced:100"]
MARKERS = 20
NOISE = 0.005  # of the body's length
LEVEL = 0.9
LEAST = 0.05  # of the body's length: displacement of a load that counts
WEIGHT = 1.0  # of the largest component of a force, over the body
STIFFNESS = (0.5, 2.0)  # least and largest, of the run's Young's modulus
TRUTH = 1e-4  # of the displacement: error of the equilibrium
TASKS = {"force": "force", "place": "force somewhere", "modulus": "E", "both": "force and E"}


def surface_points(geometry: Any, count: int, rng: np.random.Generator) -> tuple[Array, Array]:
    """Random points of the surface in m, (m, d), and their interpolation, (m, n_nodes)."""
    facets = geometry.surface_facets[rng.integers(len(geometry.surface_facets), size=count)]
    weights = np.zeros((count, len(geometry.coordinates)))
    shares = rng.dirichlet(np.ones(facets.shape[1]), size=count)
    weights[np.arange(count)[:, None], facets] = shares
    return weights @ geometry.coordinates, weights


def compare(name: str, count: int, seed: int, task: str, truth_run: str | None) -> Results:
    """Identify random loads on one body."""
    model = surrogate.load(name)
    model.prepare("surface")
    exact = surrogate.load(truth_run or name)
    here, there = model.geometry, exact.geometry
    length = float(np.ptp(here.coordinates, axis=0).max())
    free = here.free[here.surface_nodes].all(axis=1)
    nodes, limit = here.surface_nodes[free], np.array(model.description.data.info.force.max_abs)
    volume = float(np.prod(np.ptp(here.coordinates, axis=0)))
    weight = np.zeros(here.dimension)
    weight[-1] = -WEIGHT * float(limit.max()) / volume
    fields, forces, places, moduli, seconds = [], [], [], [], []
    inside, field_inside, near, failed, tried = [], [], [], 0, 0
    number = 0
    while tried < count:
        rng = np.random.default_rng([seed, number])
        number += 1
        node, force = int(rng.choice(nodes)), rng.uniform(-limit, limit)
        place = ",".join(map(repr, map(float, here.coordinates[node])))
        text = f"{place}:{','.join(map(repr, map(float, force)))}"
        young = modulus(model) * float(np.exp(rng.uniform(*np.log(STIFFNESS))))
        known: dict[str, Any] = {}
        if task == "modulus":
            known = {"load": [text], "nearest": True}
        elif task == "both":
            known = {"body_force": tuple(weight)}
        acting: dict[str, Any] = {"load": [text], "nearest": True} | known
        stiff = young if task in {"modulus", "both"} else None
        solution = exact.solve(**acting, young_modulus=stiff, tolerance=TRUTH)
        if solution.descent is None or not solution.descent.reached:
            continue
        truth = solution.displacement
        if np.abs(truth).max() < LEAST * length:
            continue
        tried += 1
        x, weights = surface_points(there, MARKERS, rng)
        seen = x + weights @ truth + rng.normal(0, NOISE * length, x.shape)
        seen[[0, 1]], seen[2] = seen[[1, 0]], np.nan
        markers = surrogate.Markers.of(x, seen)
        unknown = {
            "force": [place],
            "place": ["somewhere"],
            "modulus": ["young-modulus"],
            "both": [place, "young-modulus"],
        }[task]
        work = partial(surrogate.identify, model, markers, unknown, level=LEVEL, **known)
        try:
            found, taken = timed(work)
        except WorkError as error:
            print(name, task, number, error, file=sys.stderr)
            failed += 1
            continue
        seconds.append(taken)
        sought = {"modulus": np.array([young]), "both": np.append(force, young)}.get(task, force)
        inside += list((found.lower <= sought) & (sought <= found.upper))
        if task != "modulus":
            off_force = np.linalg.norm(found.values[: len(force)] - force)
            forces.append(off_force / np.linalg.norm(force))
        if "young-modulus" in unknown:
            moduli.append(abs(found.values[-1] / young - 1))
        if found.place is not None and found.place_std is not None:
            off = float(np.linalg.norm(found.place - here.coordinates[node]))
            places.append(off / length)
            near.append(off <= 2 * found.place_std + 1e-9 * length)
        if truth_run is None:
            wrong = np.linalg.norm(found.displacement - truth, axis=1)
            half = 1.645 * found.std_displacement[here.free]
            field_inside.append((np.abs(found.displacement - truth)[here.free] <= half).mean())
        else:  # at the points of the surface, which are in both meshes
            at = surrogate.Markers.of(x, x).interpolation(here) @ found.displacement
            wrong = np.linalg.norm(at - weights @ truth, axis=1)
        fields.append(float(wrong.max()) / length)
        print(name, task, number, f"{fields[-1]:.1e}", file=sys.stderr)
    return {
        "name": name,
        "task": task,
        "truth": truth_run,
        "trials": tried,
        "failed": failed,
        "field_median": rounded(np.median(fields)),
        "field_95": rounded(np.quantile(fields, 0.95)),
        "force_median": rounded(np.median(forces)) if forces else None,
        "inside": rounded(float(np.mean(inside))),
        "field_inside": rounded(np.mean(field_inside)) if field_inside else None,
        "modulus_median": rounded(np.median(moduli)) if moduli else None,
        "modulus_95": rounded(np.quantile(moduli, 0.95)) if moduli else None,
        "place_median": rounded(np.median(places)) if places else None,
        "place_near": rounded(float(np.mean(near))) if near else None,
        "ms": rounded(1e3 * np.median(seconds)),
    }


def modulus(model: surrogate.Surrogate) -> float:
    """Young's modulus of a run in Pa."""
    return float(model.description.data.case["material"]["young_modulus"])


def measure(options: argparse.Namespace) -> Results:
    """Results for some networks."""
    found = [
        over_networks(
            options, partial(compare, seed=options.seed, task=task, truth_run=options.truth)
        )
        for task in TASKS
    ]
    return {**found[0], "networks": [of for each in found for of in each["networks"]]}


def page(results: Results) -> str:
    """Make the page."""

    def cell(form: str, name: str) -> Callable[[Results], str]:
        return lambda of: "" if of[name] is None else form.format_map(of)

    rows = table_of(
        results["networks"],
        {
            "network": "`{name}`",
            "sought": lambda of: TASKS[of["task"]],
            "trials": "{trials}",
            "failed": "{failed}",
            "field, median (95 %)": "{field_median:.2%} ({field_95:.2%})",
            "force, median": cell("{force_median:.1%}", "force_median"),
            "E, median (95 %)": cell("{modulus_median:.1%} ({modulus_95:.1%})", "modulus_95"),
            "place, median": cell("{place_median:.1%}", "place_median"),
            "parameters inside": "{inside:.1%}",
            "field inside": cell("{field_inside:.1%}", "field_inside"),
            "ms": "{ms:.3g}",
        },
    )
    return (
        f"{MARKERS} markers on the surface, with noise of {NOISE:.1%} of the body's length; two "
        "are swapped, one is not seen. A random force, like those of the training, moves the body "
        f"by {LEAST:.0%} of its length at least (seed {results['seed']}, {results['threads']} "
        "thread). Sought is this force at a known place; at an unknown node of the surface; "
        f"Young's modulus, {STIFFNESS[0]:g} to {STIFFNESS[1]:g} times that of the run, under the "
        "known force; or both at a known place, beside a known weight. Errors of field (worst "
        "node) and place are relative to the length, those of forces and modulus to themselves. "
        f"*Inside* are intervals of {LEVEL:.0%}, of parameters and of components of the field."
        f"\n\n{rows}"
    )


def arguments(parser: Parser) -> None:
    """Add the options."""
    add_counted_networks(parser, NETWORKS, "trials", seed=331)
    parser.add_argument("--truth", metavar="RUN", help="run of the same body on another mesh")


TITLE = "Identification from markers"
