"""Errors of deterministic U-Nets on the test splits (Table "det_metrics")."""

from __future__ import annotations

from surrogate.evaluation.paper import PAPER
from surrogate.studies.accuracy import accuracy_table, error_comparisons
from surrogate.studies.study import Outcome, Study
from surrogate.studies.workshop import Workshop

RUNS = ("beam2d-det", "lshape2d-det", "beam3d-det")


def conduct(workshop: Workshop) -> Outcome:
    """Measure ē and σ(e) of all three cases."""
    return Outcome(
        tables=[accuracy_table(workshop, RUNS, "Errors of deterministic U-Nets on test splits.")],
        comparisons=[
            comparison
            for run in RUNS
            for comparison in error_comparisons(
                workshop, run, PAPER.networks[workshop.case_of(run)]["deterministic"]
            )
        ],
    )


STUDY = Study(
    name="deterministic-accuracy",
    title="Accuracy of deterministic U-Nets",
    labels=("tab: det_metrics",),
    question="How large is the error on test samples, on average and from sample to sample?",
    conduct=conduct,
    runs=RUNS,
)
