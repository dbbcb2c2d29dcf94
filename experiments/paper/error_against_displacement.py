"""Error of test samples over displacement (Figures "det_sensitivity", "average_errors")."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from experiments.framework.experiment import Experiment, Findings
from experiments.framework.record import MARGIN, Claim, Table, compare
from experiments.framework.resources import Resources
from experiments.measures.errors_on_test_split import MM, name_of, split_errors
from experiments.paper.published_numbers import PAPER
from shared_schema.common.drawing import make_figure, styled
from surrogate.figures import CURVES
from surrogate.learning.measures import displacement_at_load, sample_errors

Array = NDArray[np.float64]
DETERMINISTIC = ("beam2d-det", "lshape2d-det", "beam3d-det")
BAYESIAN = ("beam2d-vb", "lshape2d-vb")
LOW = max(  # largest slope of the paper, which calls all of them low
    network.slope for case in PAPER.networks.values() for network in case.values()
)


@styled
def errors_over_displacement(resources: Resources, runs: Sequence[str]) -> Figure:
    """Draw e_m of every test sample over the displacement at its load, with regression lines.

    One panel for each run, because errors of one may be invisible at the scale of another.
    """
    figure = make_figure(3.2 * len(runs), 2.8)
    panels = figure.subplots(1, len(runs), squeeze=False)[0]
    for axes, run, color in zip(panels, runs, CURVES, strict=False):
        moved, errors = moved_and_errors(resources, run)
        axes.plot(moved, MM * errors, "o", ms=2.4, mew=0, color=color, alpha=0.5)
        line, ends = split_errors(resources, run), (0.0, float(moved.max()))
        axes.plot(ends, [MM * (line.intercept + line.slope * end) for end in ends], color=color)
        slope = rf"slope ${MM * line.slope:.3g}\times10^{{-3}}$"
        axes.set_title(f"{name_of(resources, run)}, {slope}", fontsize=10)
        axes.set_xlim(left=0)
        axes.set_ylim(bottom=0)
    figure.supxlabel("displacement magnitude at the loaded node [m]", fontsize=10)
    panels[0].set_ylabel(r"mean error $e_m$ [mm]")
    return figure


def measure(resources: Resources) -> Findings:
    """Measure slopes, and draw the deterministic cases and the probabilistic ones."""
    runs = (*DETERMINISTIC, *BAYESIAN)
    lines = {run: split_errors(resources, run) for run in runs}
    names = {run: name_of(resources, run) for run in runs}
    rows = [
        (
            names[run],
            MM * line.slope,
            MM * line.intercept,
            growth(*moved_and_errors(resources, run)),
        )
        for run, line in lines.items()
    ]
    table = Table(
        caption="Least-squares lines of e_m over the displacement magnitude at the loaded node. "
        "Last column: mean e_m of the half of the samples with the larger displacements over that "
        "of the other half.",
        head=("example", "slope [10⁻³]", "intercept [mm]", "upper half / lower half"),
        rows=tuple(rows),
    )
    likelihoods = {run: resources.config_of(run).likelihood for run in runs}
    comparisons = [
        compare(
            f"{names[run]}: absolute slope",
            "10⁻³",
            MM * abs(line.slope),
            MM * PAPER.networks[resources.case_of(run)][likelihoods[run]].slope,
        )
        for run, line in lines.items()
    ]
    caption = "Mean error of every test sample over the displacement at its load: {} U-Nets."
    return Findings(
        tables=[table],
        comparisons=comparisons,
        claims=[sensitivity_claim({names[run]: line.slope for run, line in lines.items()})],
        figures={
            "deterministic": (
                errors_over_displacement(resources, DETERMINISTIC),
                caption.format("deterministic"),
            ),
            "bayesian": (errors_over_displacement(resources, BAYESIAN), caption.format("Bayesian")),
        },
    )


def moved_and_errors(resources: Resources, run: str) -> tuple[Array, Array]:
    """Displacement at the load and e_m of every test sample: (M,) each, in m."""
    test = resources.dataset_of(run).nodal_test
    errors = sample_errors(resources.predicted_test(run).mean, test.displacement)
    return displacement_at_load(test.force, test.displacement), errors


def growth(moved: Array, errors: Array) -> float:
    """Ratio of the mean errors of the samples with large and with small displacements."""
    lower, upper = np.array_split(errors[np.argsort(moved)], 2)
    return float(upper.mean() / lower.mean())


def sensitivity_claim(slopes: dict[str, float]) -> Claim:
    """Claim on the slopes of all cases."""
    steepest = max(slopes, key=lambda name: abs(slopes[name]))
    return Claim(
        what="Errors depend little on the displacement magnitude, in all cases.",
        holds=abs(slopes[steepest]) <= MARGIN * LOW,
        evidence=(
            f"The steepest line, of {steepest}, rises by {MM * slopes[steepest]:.3g} mm "
            f"in a metre (≤ {MARGIN * MM * LOW:g} mm, {MARGIN:g} times the largest slope that the "
            f"paper calls low, {MM * LOW:g} mm)."
        ),
    )


STUDY = Experiment(
    name="error-against-displacement",
    title="Error against displacement",
    labels=("fig: det_sensitivity", "average_errors_bayesian"),
    question="Do errors grow with the displacement at the load?",
    measure=measure,
    runs=(*DETERMINISTIC, *BAYESIAN),
)
