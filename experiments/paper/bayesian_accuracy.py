"""Variational Bayes on the test splits, beside deterministic U-Nets (Table "bayesian_table")."""

from __future__ import annotations

from experiments.framework.experiment import Experiment, Findings
from experiments.framework.record import Claim, Table
from experiments.framework.resources import Resources
from experiments.measures.errors_on_test_split import (
    BODIES,
    MM,
    accuracy_table,
    error_comparisons,
    name_of,
    split_errors,
)
from experiments.paper.published_numbers import PAPER
from surrogate.learning.probabilistic import INTERVALS, CalibrationMeasures, measure_calibration

CASES = ("beam2d", "lshape2d")
BAYESIAN = tuple(f"{case}-vb" for case in CASES)
RUNS = tuple(f"{case}-{kind}" for case in CASES for kind in ("vb", "det"))


def measure(resources: Resources) -> Findings:
    """Measure ē, σ(e) and the coverage of intervals of both plane cases."""
    caption = "Errors of the mean of variational Bayes (VB) and of deterministic U-Nets (D)."
    return Findings(
        tables=[accuracy_table(resources, RUNS, caption), coverage_table(resources)],
        comparisons=[
            comparison
            for run in BAYESIAN
            for comparison in error_comparisons(
                resources, run, PAPER.networks[resources.case_of(run)]["variational_bayes"]
            )
        ],
        claims=[larger_error(resources, case) for case in CASES],
    )


def calibration(resources: Resources, run: str) -> CalibrationMeasures:
    """Measure the calibration of a run on its test split."""
    dataset, predicted = resources.dataset_of(run), resources.predicted_test(run)
    free = dataset.geometry.free
    return measure_calibration(predicted.mean, predicted.std, dataset.nodal_test.displacement, free)


def coverage_table(resources: Resources) -> Table:
    """Table of the coverage of the intervals and the mean σ of every Bayesian network."""
    rows: list[tuple[str | float, ...]] = []
    for run in BAYESIAN:
        measures = calibration(resources, run)
        covered = [100 * interval.coverage for interval in measures.intervals]
        rows.append((name_of(resources, run), *covered, MM * measures.mean_std))
    heads = [f"in {100 * level:g} % intervals [%]" for level in INTERVALS]
    return Table(
        caption="Components of the test split inside the predicted central intervals, and the mean "
        "predicted standard deviation. The paper gives neither.",
        head=("example", *heads, "mean σ [mm]"),
        rows=tuple(rows),
    )


def larger_error(resources: Resources, case: str) -> Claim:
    """Test whether the Bayesian network has a larger error than the deterministic one."""
    bayesian = split_errors(resources, f"{case}-vb").mean_error
    deterministic = split_errors(resources, f"{case}-det").mean_error
    papers = [PAPER.networks[case][kind] for kind in ("variational_bayes", "deterministic")]
    return Claim(
        what=f"{BODIES[case]}: variational Bayes has a larger error than the deterministic U-Net.",
        holds=bayesian > deterministic,
        evidence=f"ē = {MM * bayesian:.3g} and {MM * deterministic:.3g} mm; the paper: "
        f"{papers[0].mean_error_mm:.3g} and {papers[1].mean_error_mm:.3g} mm.",
        better=True,
    )


STUDY = Experiment(
    name="bayesian-accuracy",
    title="Accuracy of Bayesian U-Nets",
    labels=("tab:bayesian_table",),
    question="How much accuracy does a network lose that also predicts its uncertainty, and how "
    "often do its intervals contain the error?",
    measure=measure,
    runs=RUNS,
)
