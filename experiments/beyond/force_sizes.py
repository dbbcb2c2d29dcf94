"""Error by the size of the force at one node, within and beyond the range of the training."""

from __future__ import annotations

import numpy as np

from experiments.beyond.error_curves import Curve, draw_curves
from experiments.beyond.networks import (
    BODIES,
    kind_of,
    patterns,
    runs_by_body,
    stem_of,
)
from experiments.framework.experiment import Experiment, Findings
from experiments.framework.record import Cell, Table
from experiments.framework.resources import Resources
from experiments.measures.errors_on_test_split import MM
from surrogate.learning.measures import ForceSweep, force_sweep

COMPARED = ("forces", "mechanics", "reduced", "gp", "modal-gp")
REACHES = (0.5, 1.0, 1.5, 2.0, 3.0, 4.0)  # forces of the table, over the largest in training


def measure(resources: Resources) -> Findings:
    """Measure errors under sweeps of the force on every body of the scale that has one."""
    result, scale = Findings(), resources.scale
    sweeps = {
        run: force_sweep(resources.predicted_loads(run, dataset))
        for case, runs in runs_by_body(scale, COMPARED).items()
        if (dataset := f"{stem_of(case)}_sweep") in scale.datasets
        for run in runs
    }
    if not sweeps:
        return result
    result.tables.append(reach_table(resources, sweeps))
    panels: dict[str, list[Curve]] = {}
    trained = {}
    for run, sweep in sweeps.items():
        body = BODIES[resources.case_of(run)]
        errors = (MM * sweep.node_error).tolist()
        panels.setdefault(body, []).append(Curve(sweep.force.tolist(), errors, kind_of(run)))
        trained[body] = (-sweep.limit, sweep.limit)
    result.figures["errors"] = (
        draw_curves(
            panels,
            "force component at the node [N]",
            "error at the node [mm]",
            trained,
            markers=False,
        ),
        "Error ‖U − u‖₂ at the loaded node over the force there; grey, the range of the training.",
    )
    return result


def reach_table(resources: Resources, sweeps: dict[str, ForceSweep]) -> Table:
    """Table of the errors at several multiples of the largest force in training."""
    rows: list[tuple[Cell, ...]] = []
    for run, sweep in sweeps.items():
        largest = float(np.abs(sweep.force).max())
        cells = [
            MM * sweep.at(reach * sweep.limit, sweep.node_error)
            if reach * sweep.limit <= largest * (1 + 1e-6)
            else None
            for reach in REACHES
        ]
        rows.append((BODIES[resources.case_of(run)], kind_of(run).label, sweep.limit, *cells))
    return Table(
        caption="Error ‖U − u‖₂ at the loaded node in mm, mean of both senses, by the size of the "
        "force over the largest component a in training.",
        head=("example", "network", "a [N]", *(f"{reach:g} a" for reach in REACHES)),
        rows=tuple(rows),
    )


STUDY = Experiment(
    name="force-sizes",
    title="Error by the size of the force",
    question="How do errors grow with the force at one node, within the range of the training and "
    "up to four times as far or more?",
    measure=measure,
    datasets=("*_sweep",),
    runs=patterns(tuple(BODIES), COMPARED),
)
