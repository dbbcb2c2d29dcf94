"""Errors of deterministic U-Nets on the test splits (Table "det_metrics")."""

from __future__ import annotations

from experiments.components.errors_on_test_split import accuracy_table, error_comparisons
from experiments.framework.resources import Resources
from experiments.framework.study import Study, StudyResult
from experiments.paper.published_numbers import PAPER

RUNS = ("beam2d-det", "lshape2d-det", "beam3d-det")


def measure(resources: Resources) -> StudyResult:
    """Measure ē and σ(e) of all three cases."""
    return StudyResult(
        tables=[accuracy_table(resources, RUNS, "Errors of deterministic U-Nets on test splits.")],
        comparisons=[
            comparison
            for run in RUNS
            for comparison in error_comparisons(
                resources, run, PAPER.networks[resources.case_of(run)]["deterministic"]
            )
        ],
    )


STUDY = Study(
    name="deterministic-accuracy",
    title="Accuracy of deterministic U-Nets",
    labels=("tab: det_metrics",),
    question="How large is the error on test samples, on average and from sample to sample?",
    measure=measure,
    runs=RUNS,
)
