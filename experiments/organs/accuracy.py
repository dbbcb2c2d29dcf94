"""Errors and intervals of every kind of network on the organs, beside the load series alone."""

from __future__ import annotations

import numpy as np

from experiments.framework.experiment import Experiment, Findings, Setting
from experiments.framework.record import Cell, Table
from experiments.framework.resources import Resources
from experiments.framework.timing import median_seconds
from experiments.measures.predicted_samples import PredictedSamples
from experiments.organs.predictors import HUNDREDTHS_OF_MM, RUNS, Predictor, predictors
from surrogate.learning.measures import node_errors

SHARES = 0.005, 0.02, 0.04  # of the largest displacement
MS = 1e3  # ms in a second
HEAD = (
    "body",
    "predicted by",
    "error of a component [10⁻⁵ m]",
    "median of the largest error [%]",
    *(f"within {100 * share:g} % [%]" for share in SHARES),
    "in 95 % intervals [%]",
    "training [min]",
    "prediction [ms]",
)


def measure(resources: Resources) -> Findings:
    """Predict the test split of every run."""
    rows = tuple(row(resources, predictor) for predictor in predictors(resources))
    table = Table(
        caption="Test splits: mean absolute error of a displacement component, and largest error "
        "of a node over the largest displacement of the sample: its median, and the share of loads "
        "for which it is within some percent. Free components inside their 95 % intervals, if "
        "there are any. Time of one prediction on one thread, all passes included.",
        head=HEAD,
        rows=rows,
    )
    return Findings([table])


def row(resources: Resources, predictor: Predictor) -> tuple[Cell, ...]:
    """Measure one predictor."""
    test = resources.dataset_of(predictor.run).nodal_test
    passes = resources.scale.passes
    predicted = predictor.predict(test.force, passes, Setting.seed)
    error = np.abs(predicted.mean - test.displacement)
    largest = node_errors(predicted.mean, test.displacement).max(axis=1)
    relative = largest / np.linalg.norm(test.displacement, axis=2).max(axis=1)
    covered: Cell = None
    if predictor.surrogate.is_probabilistic:
        fields = test.force, test.displacement, predicted
        samples = PredictedSamples(predictor.surrogate.geometry, *fields)
        covered = 100 * float(samples.covered.mean())
    work = predictor.predict_one(test.force[0], passes)
    seconds = median_seconds(work, resources.scale.timing)
    minutes = resources.run_record(predictor.run).minutes
    return (
        predictor.body,
        predictor.label,
        HUNDREDTHS_OF_MM * float(error.mean()),
        100 * float(np.median(relative)),
        *(100 * float((relative <= share).mean()) for share in SHARES),
        covered,
        minutes if predictor.tolerance is None else None,
        MS * seconds,
    )


STUDY = Experiment(
    name="organ-accuracy",
    title="Errors and intervals",
    question="How accurate is every kind of network on the organs, beside the load series, which "
    "has seen no sample, and do its intervals hold?",
    measure=measure,
    runs=RUNS,
    times=True,
)
