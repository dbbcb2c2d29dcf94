"""Several loads at once on a network trained on single ones (Figure "multiple_force")."""

from __future__ import annotations

from surrogate import figures
from surrogate.example import find_example, tip_measures
from surrogate.metrics import measure
from surrogate.studies.accuracy import MM, test_errors
from surrogate.studies.error_pattern import error_follows_displacement
from surrogate.studies.record import Claim, Table, compare
from surrogate.studies.study import Outcome, Study
from surrogate.studies.workshop import Workshop

RUN, LOADS = "beam2d-det", "beam2d_multiple"
TIP_DISPLACEMENT, RELATIVE_TIP_ERROR = 0.55, 0.006  # m; Figure "multiple_force" and its text
CLOSELY = 0.05  # relative tip error at most
LESS = 0.1  # in rank correlation, at least: another trend


def conduct(workshop: Workshop) -> Outcome:
    """Show the example, and measure errors under single and under several loads."""
    loads = workshop.predicted_loads(RUN, LOADS)
    geometry, samples, predicted = loads.surrogate.geometry, loads.samples, loads.predicted.mean
    several = measure(samples.force, predicted, samples.displacement, geometry.tip)
    single = test_errors(workshop, RUN)
    number = find_example(
        samples.force, samples.displacement, geometry.tip, geometry.loadable, TIP_DISPLACEMENT
    )
    reference = samples.displacement[number]
    moved, error = tip_measures(predicted[number], reference, geometry.tip)
    rows = [
        (name, e.samples, MM * e.mean_error, MM * e.std_error, 100 * e.relative_tip_error_median)
        for name, e in (("one", single), ("several", several))
    ]
    test = workshop.dataset_of(RUN).nodal_test
    follows = [
        float(error_follows_displacement(mean, reference, ~geometry.clamped).mean())
        for mean, reference in (
            (workshop.predicted_test(RUN).mean, test.displacement),
            (predicted, samples.displacement),
        )
    ]
    count = int(samples.force[number].any(axis=1).sum())
    return Outcome(
        tables=[
            Table(
                caption="Errors of the deterministic U-Net under one load and under several.",
                head=("loads", "M", "ē [mm]", "σ(e) [mm]", "median relative tip error [%]"),
                rows=tuple(rows),
            )
        ],
        comparisons=[
            compare(
                f"relative tip error at {moved:.2f} m (paper: {TIP_DISPLACEMENT} m)",
                "%",
                100 * error,
                100 * RELATIVE_TIP_ERROR,
            )
        ],
        claims=[accuracy_claim(several.relative_tip_error_median), pattern_claim(*follows)],
        figures={
            "example": (
                figures.meshes_and_errors(
                    geometry, predicted[number], reference, samples.force[number]
                ),
                f"{count} loads on the 2D beam, trained on single ones: the tip moves by "
                f"{moved:.2f} m. Left the meshes, right the nodal error on the predicted one.",
            )
        },
    )


def accuracy_claim(tip_error: float) -> Claim:
    """Claim on the median relative tip error under several loads."""
    return Claim(
        what="Trained on single loads, the network closely follows the solution under several.",
        holds=tip_error <= CLOSELY,
        evidence=f"Median relative tip error {100 * tip_error:.3g} % (≤ {100 * CLOSELY:g} %).",
    )


def pattern_claim(single: float, several: float) -> Claim:
    """Claim on the mean rank correlations of nodal error and displacement."""
    return Claim(
        what=(
            "Under several loads the error shows a different trend: it is high not only where "
            "the deformation is."
        ),
        holds=several <= single - LESS,
        evidence=(
            "Mean rank correlation of nodal error and displacement: "
            f"{several:.2f} under several loads, {single:.2f} under one (by {LESS} less)."
        ),
    )


STUDY = Study(
    name="multiple-loads",
    title="Several loads at once",
    labels=("fig: multiple_force",),
    question="How does a network that is trained on single loads predict several at once?",
    conduct=conduct,
    datasets=(LOADS,),
    runs=(RUN,),
)
