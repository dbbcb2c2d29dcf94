"""Errors of deterministic U-Nets on the test splits (Table "det_metrics")."""

from __future__ import annotations

from experiments.framework.experiment import Experiment, Findings
from experiments.framework.resources import Resources
from experiments.measures.errors_on_test_split import accuracy_table, error_comparisons
from experiments.paper.published_numbers import PAPER

RUNS = ("beam2d-det", "lshape2d-det", "beam3d-det")


def measure(resources: Resources) -> Findings:
    """Measure ē and σ(e) of all three cases."""
    return Findings(
        tables=[accuracy_table(resources, RUNS, "Errors of deterministic U-Nets on test splits.")],
        comparisons=[
            comparison
            for run in RUNS
            for comparison in error_comparisons(
                resources, run, PAPER.networks[resources.case_of(run)]["deterministic"]
            )
        ],
    )


STUDY = Experiment(
    name="deterministic-accuracy",
    title="Accuracy of deterministic U-Nets",
    labels=("tab: det_metrics",),
    question="How large is the error on test samples, on average and from sample to sample?",
    measure=measure,
    runs=RUNS,
)
