"""Error by the number of loads, up to that of the training and beyond."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

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
from experiments.measures.predicted_samples import PredictedSamples, predicted_samples

COMPARED = ("forces", "mechanics", "reduced")


def measure(resources: Resources) -> Findings:
    """Measure errors by the number of loads on every body of the scale."""
    result = Findings()
    samples = {
        run: predicted_samples(resources, run, f"{stem_of(case)}_many")
        for case, runs in runs_by_body(resources.scale, COMPARED).items()
        for run in runs
    }
    most = max(int(found.number.max()) for found in samples.values())
    result.tables = [number_table(resources, samples, most, relative) for relative in (False, True)]
    panels: dict[str, list[Curve]] = {}
    trained = {}
    for run, found in samples.items():
        case, counts = resources.case_of(run), np.unique(found.number)
        errors = [MM * float(found.error[found.number == n].mean()) for n in counts]
        panels.setdefault(BODIES[case], []).append(Curve(counts.tolist(), errors, kind_of(run)))
        limit = loads_in_training(resources, run)
        trained[BODIES[case]] = (0.5, limit + 0.5)
    result.figures["errors"] = (
        draw_curves(panels, "number of loads", "mean error [mm]", trained),
        "Mean error over the number of loaded nodes; grey, the numbers in the training.",
    )
    return result


def loads_in_training(resources: Resources, run: str) -> int:
    """Largest number of loads in the training of a run, by its case."""
    return int(resources.dataset_of(run).manifest.case["load"].get("count", (1, 1))[1])


def number_table(
    resources: Resources, samples: dict[str, PredictedSamples], most: int, relative: bool
) -> Table:
    """Table of the errors by number, in mm or relative to the displacement in %."""
    rows: list[tuple[Cell, ...]] = []
    for run, found in samples.items():
        cells: list[Cell] = []
        for number in range(1, most + 1):
            here: NDArray[np.bool_] = found.number == number
            if not here.any():
                cells.append(None)
            else:
                cells.append(
                    100 * found.relative(here) if relative else MM * found.error[here].mean()
                )
        rows.append((BODIES[resources.case_of(run)], kind_of(run).label, *cells))
    what = "Mean error over mean displacement in %" if relative else "Mean error in mm"
    return Table(
        caption=f"{what}, by the number of loaded nodes. Samples of the cases `*_many` or, where "
        "there is none, of the test split.",
        head=("example", "network", *map(str, range(1, most + 1))),
        rows=tuple(rows),
    )


STUDY = Experiment(
    name="loads-by-number",
    title="Error by the number of loads",
    question="How does the error grow with the number of loads, up to that of the training and to "
    "twice as many?",
    measure=measure,
    datasets=("*_many",),
    runs=patterns(tuple(BODIES), COMPARED),
)
