"""Growth of the uncertainty outside the training: larger forces, other places, more loads."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from experiments.beyond.coverage import OF_SIZE, UNCERTAIN
from experiments.beyond.error_curves import Curve, draw_curves
from experiments.beyond.networks import BODIES, kind_of, patterns, runs_by_body, stem_of
from experiments.framework.experiment import Experiment, Findings
from experiments.framework.record import Cell, Table
from experiments.framework.resources import Resources
from experiments.measures.errors_on_test_split import MM
from experiments.measures.predicted_samples import (
    PredictedSamples,
    distance_from,
    distance_groups,
    predicted_samples,
)

SINGLE = ("forces-vb", "mechanics-vb", "reduced-vb")  # kinds also trained on single loads
STEMS = tuple(stem_of(case) for case in BODIES)
REACHES = (1.0, 1.5, 2.0, 3.0, 4.0, 6.0)  # ends of the groups of forces, over that of the training

Group = tuple[str, float, NDArray[np.bool_]]  # label, abscissa, mask of the samples (M,)


def measure(resources: Resources) -> Findings:
    """Measure errors, standard deviations and coverage outside the training."""
    result, scale = Findings(), resources.scale
    bodies = runs_by_body(scale, UNCERTAIN)
    larger: dict[str, list[Curve]] = {}
    for case, runs in bodies.items():
        body, stem = BODIES[case], stem_of(case)
        if (dataset := f"{stem}_sweep") in scale.datasets:
            samples = {run: predicted_samples(resources, run, dataset, True) for run in runs}
            reach = resources.predicted_loads(runs[0], dataset).reach
            groups = reach_groups(reach)
            result.tables.append(
                group_table(f"{body}, one force beyond the range", samples, groups)
            )
            larger[body] = error_and_std(samples, groups)
        if (dataset := f"{stem}_many") in scale.datasets:
            samples = {run: predicted_samples(resources, run, dataset, True) for run in runs}
            groups = number_groups(next(iter(samples.values())))
            result.tables.append(group_table(f"{body}, number of loads", samples, groups))
    if larger:
        result.figures["forces"] = (
            draw_curves(
                larger, "force over the largest in training", "error (solid), σ (dotted) [mm]"
            ),
            "Mean error and mean standard deviation under one growing force.",
        )
    elsewhere: dict[str, list[Curve]] = {}
    for case, body in BODIES.items():
        stem = stem_of(case)
        dataset = f"{stem}_places"
        singles = [run for kind in SINGLE if (run := f"{stem}-{kind}") in scale.runs]
        if stem == case or not singles or dataset not in scale.datasets:
            continue
        samples = {run: predicted_samples(resources, run, dataset, True) for run in singles}
        distance = distance_from(samples[singles[0]], resources.structured(stem).geometry.loadable)
        groups = [(f"{d:.2f} m", d, mask) for d, mask in distance_groups(distance)]
        caption = (
            f"{body}, networks trained on single loads, by the distance from the places of these"
        )
        result.tables.append(group_table(caption, samples, groups))
        elsewhere[body] = error_and_std(samples, groups)
    if elsewhere:
        result.figures["places"] = (
            draw_curves(
                elsewhere,
                "distance of the load from those of the training [m]",
                "error (solid), σ (dotted) [mm]",
            ),
            "Mean error and mean standard deviation of networks trained on single loads on a few "
            "nodes, under single loads on all nodes.",
        )
    return result


def reach_groups(reach: NDArray[np.float64]) -> list[Group]:
    """Groups of samples by the size of the force over the largest in training, (M,)."""
    groups: list[Group] = []
    low = 0.0
    for high in REACHES:
        mask = (reach > low) & (reach <= high * (1 + 1e-2))
        if mask.any():
            groups.append((f"up to {high:g} a", float(reach[mask].mean()), mask))
        low = high * (1 + 1e-2)
    return groups


def number_groups(samples: PredictedSamples) -> list[Group]:
    """Groups of samples by the number of loads."""
    return [(str(n), float(n), samples.number == n) for n in np.unique(samples.number)]


def group_table(what: str, samples: dict[str, PredictedSamples], groups: Sequence[Group]) -> Table:
    """Table of errors, standard deviations and coverage by group."""
    rows: list[tuple[Cell, ...]] = []
    for run, found in samples.items():
        quantities = [
            ("mean error [mm]", MM * found.error),
            ("mean σ [mm]", MM * found.std),
            ("inside 95 % intervals [%]", 100 * found.covered),
        ]
        if found.certificate is not None:
            quantities.append((f"inside those{OF_SIZE} [%]", 100 * found.covered_with_size))
        rows += [
            (kind_of(run).label, name, *(float(values[mask].mean()) for _, _, mask in groups))
            for name, values in quantities
        ]
    return Table(
        caption=f"{what}.",
        head=("network", "", *(label for label, _, _ in groups)),
        rows=tuple(rows),
    )


def error_and_std(samples: dict[str, PredictedSamples], groups: Sequence[Group]) -> list[Curve]:
    """Curves of mean error (solid) and mean σ (dotted) over the abscissa of the groups."""
    x = [place for _, place, _ in groups]
    return [
        Curve(x, [MM * float(values[mask].mean()) for _, _, mask in groups], kind_of(run), style)
        for run, found in samples.items()
        for values, style in ((found.error, "-"), (found.std, ":"))
    ]


STUDY = Experiment(
    name="uncertainty-outside",
    title="Uncertainty outside the training",
    question="Does the uncertainty grow as the errors do, under forces beyond the range of the "
    "training, under more loads, and under loads on nodes that the training left out?",
    measure=measure,
    datasets=("*_sweep", "*_many", "*_places", *STEMS),
    runs=patterns(tuple(BODIES), UNCERTAIN) + patterns(STEMS, SINGLE),
)
