"""Error by the number of loads, up to that of the training and beyond."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from experiments.beyond.error_curves import Curve, draw_curves
from experiments.beyond.networks import (
    BODIES,
    KINDS,
    kind_of,
    patterns,
    runs_by_body,
    stem_of,
)
from experiments.beyond.predicted_samples import PredictedSamples, predicted_samples
from experiments.components.errors_on_test_split import MM
from experiments.framework.resources import Resources
from experiments.framework.study import Study, StudyResult
from experiments.framework.study_record import Cell, Claim, Table

COMPARED = ("forces", "mechanics", "reduced")
INSIDE, BEYOND = 1.5, 3.0  # largest ratios of relative errors, within the training and beyond


def measure(resources: Resources) -> StudyResult:
    """Measure errors by the number of loads on every body of the scale."""
    result = StudyResult()
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
        if kind_of(run) is not KINDS["forces"]:
            result.claims += growth_claims(resources, run, found, limit)
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


def growth_claims(
    resources: Resources, run: str, found: PredictedSamples, trained: int
) -> list[Claim]:
    """Claims on the relative errors under several loads, over that under one."""
    body, label = BODIES[resources.case_of(run)], kind_of(run).label
    counts = np.unique(found.number)
    if counts[0] != 1:
        return []
    one = found.relative(found.number == 1)
    ratios = {int(n): found.relative(found.number == n) / one for n in counts[1:]}
    claims = []
    for within, limit in ((True, INSIDE), (False, BEYOND)):
        here = {n: ratio for n, ratio in ratios.items() if (n <= trained) == within}
        if here:
            where = "as many loads as in training" if within else "more loads than in training"
            claims.append(
                Claim(
                    what=f"{body}, {label}: under {where}, the error relative to the displacement "
                    f"is at most {limit:g} times that under one.",
                    holds=max(here.values()) <= limit,
                    evidence="By number: "
                    + ", ".join(f"{n}: {ratio:.2f}" for n, ratio in here.items())
                    + ".",
                    of_paper=False,
                )
            )
    return claims


STUDY = Study(
    name="loads-by-number",
    title="Error by the number of loads",
    labels=(),
    question="How does the error grow with the number of loads, up to that of the training and to "
    "twice as many?",
    measure=measure,
    datasets=("*_many",),
    runs=patterns(tuple(BODIES), COMPARED),
)
