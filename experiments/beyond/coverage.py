"""Coverage of predicted intervals in the range of the training: by number of loads, by place."""

from __future__ import annotations

import numpy as np
from matplotlib.colors import Normalize
from numpy.typing import NDArray

from experiments.beyond.body_maps import draw_maps
from experiments.beyond.error_curves import Curve, draw_curves
from experiments.beyond.networks import (
    BODIES,
    KINDS,
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
from surrogate.learning.probabilistic import INTERVALS, CalibrationMeasures, measure_calibration

UNCERTAIN = ("mechanics-mle", "mechanics-vb", "mechanics-ensemble", "reduced-vb", "modal-gp")
BAYESIAN = {"mechanics-vb": "mechanics", "reduced-vb": "reduced"}  # and their deterministic kinds
OF_SIZE = " of the size of the fast certificate"


def measure(resources: Resources) -> Findings:
    """Measure the calibration of all networks that predict standard deviations."""
    result = Findings()
    runs = [run for runs in runs_by_body(resources.scale, UNCERTAIN).values() for run in runs]
    samples = {run: predicted_samples(resources, run, certified=True) for run in runs}
    calibrations = {run: calibration(found) for run, found in samples.items()}
    result.tables = [
        calibration_table(resources, samples, calibrations),
        number_table(resources, samples),
    ]
    certified = {run: found for run, found in samples.items() if found.certificate is not None}
    if certified:
        result.tables.append(number_table(resources, certified, with_size=True))
    result.tables.append(place_table(resources, samples))
    for run, shown in certified.items():
        if kind_of(run) == KINDS["mechanics-vb"]:
            maps = {
                "intervals of σ": by_node(shown, shown.inside),
                f"intervals{OF_SIZE}": by_node(shown, shown.inside_with_size),
            }
            case = resources.case_of(run)
            result.figures[f"places-{stem_of(case)}"] = (
                draw_maps(
                    shown.geometry, maps, Normalize(70, 100), "inside the 95 % intervals [%]"
                ),
                f"{BODIES[case]}, {kind_of(run).label}: components inside the 95 % intervals by "
                "node, over the samples of the test split.",
            )
    panels: dict[str, list[Curve]] = {}
    for run in runs:
        body, found = BODIES[resources.case_of(run)], calibrations[run]
        curve = Curve(found.levels, found.observed, kind_of(run))
        panels.setdefault(body, [Curve((0, 1), (0, 1), REFERENCE_CURVE, ":")]).append(curve)
    result.figures["calibration"] = (
        draw_curves(
            panels,
            "expected level of central intervals",
            "observed coverage",
            log=(False, False),
            markers=False,
        ),
        "Observed coverage of central intervals on the test split over their level.",
    )
    return result


REFERENCE_CURVE = KINDS["forces"]._replace(label="right coverage")


def calibration(samples: PredictedSamples) -> CalibrationMeasures:
    """Measure the calibration over the free components."""
    predicted, free = samples.predicted, samples.geometry.free
    return measure_calibration(predicted.mean, predicted.std, samples.reference, free)


def calibration_table(
    resources: Resources,
    samples: dict[str, PredictedSamples],
    calibrations: dict[str, CalibrationMeasures],
) -> Table:
    """Table of errors, standard deviations and coverage on the test splits."""
    rows: list[tuple[Cell, ...]] = []
    for run, found in calibrations.items():
        covered = [100 * interval.coverage for interval in found.intervals]
        rows.append(
            (
                BODIES[resources.case_of(run)],
                kind_of(run).label,
                MM * float(samples[run].error.mean()),
                MM * found.mean_std,
                *covered,
                found.node_rank_correlation,
                found.sample_rank_correlation,
            )
        )
    heads = [f"in {100 * level:g} % intervals [%]" for level in INTERVALS]
    return Table(
        caption="Test split: mean error, mean standard deviation, components inside central "
        "intervals, and rank correlation of error and σ over the nodes of a sample and over the "
        "samples.",
        head=("example", "network", "ē [mm]", "mean σ [mm]", *heads, "over nodes", "over samples"),
        rows=tuple(rows),
    )


def number_table(
    resources: Resources, samples: dict[str, PredictedSamples], with_size: bool = False
) -> Table:
    """Table of the coverage of the 95 % intervals by the number of loads."""
    most = max(int(found.number.max()) for found in samples.values())
    rows: list[tuple[Cell, ...]] = []
    for run, found in samples.items():
        shares = by_number(found, with_size)
        cells = (100 * shares[n] if n in shares else None for n in range(1, most + 1))
        rows.append((BODIES[resources.case_of(run)], kind_of(run).label, *cells))
    return Table(
        caption=f"Components inside the 95 % intervals{OF_SIZE if with_size else ''} in %, by the "
        "number of loads (test split).",
        head=("example", "network", *map(str, range(1, most + 1))),
        rows=tuple(rows),
    )


def by_number(samples: PredictedSamples, with_size: bool = False) -> dict[int, float]:
    """Share of the components inside the 95 % intervals, by the number of loads."""
    numbers = np.unique(samples.number)
    covered = samples.covered_with_size if with_size else samples.covered
    return {int(n): float(covered[samples.number == n].mean()) for n in numbers}


def place_table(resources: Resources, samples: dict[str, PredictedSamples]) -> Table:
    """Table of the coverage of the 95 % intervals by the place of the components."""
    rows: list[tuple[Cell, ...]] = []
    for run, found in samples.items():
        cells: list[Cell] = []
        for certified in (False, True):
            if certified and found.certificate is None:
                cells += [None] * 3
                continue
            shares = by_node(found, found.inside_with_size if certified else found.inside)
            shares = shares[np.isfinite(shares)]
            cells += [shares.min(), *np.quantile(shares, (0.05, 0.5))]
        rows.append((BODIES[resources.case_of(run)], kind_of(run).label, *cells))
    quantiles = ("worst node", "5 % of the nodes below", "median node")
    return Table(
        caption="Components inside the 95 % intervals in %, by the node that they belong to (test "
        f"split); then inside those{OF_SIZE}.",
        head=("example", "network", *quantiles, *(f"{name}, with size" for name in quantiles)),
        rows=tuple(rows),
    )


def by_node(samples: PredictedSamples, inside: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Share in % of the free components of every node that are inside, (n_nodes,); else NaN."""
    free = samples.geometry.free
    with np.errstate(invalid="ignore"):
        shares = (inside & free).sum(axis=(0, 2)) / (len(inside) * free.sum(axis=1))
    return np.asarray(100 * shares)


STUDY = Experiment(
    name="coverage",
    title="Coverage of predicted intervals",
    question="Do the intervals of maximum likelihood, variational Bayes, ensembles and Gaussian "
    "processes contain as many errors as they say, under one load and under several?",
    measure=measure,
    runs=patterns(tuple(BODIES), (*UNCERTAIN, *BAYESIAN.values())),
)
