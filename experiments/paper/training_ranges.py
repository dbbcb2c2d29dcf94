"""Uncertainty of networks trained on larger and on smaller forces (Fig. "overlap_intervals")."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from experiments.framework.experiment import Experiment, Findings
from experiments.framework.record import Claim, Table
from experiments.framework.resources import Resources
from experiments.measures.errors_on_test_split import MM
from shared_schema.common.drawing import NETWORK, legend_below, make_figure, styled
from surrogate.figures import OTHER
from surrogate.learning.measures import BAND, ForceSweep, force_sweep
from surrogate.learning.probabilistic import half_width

LARGER, SMALLER, SWEEP = "beam2d-vb", "beam2d_f1-vb", "beam2d_sweep"
FORCES = tuple(range(1, 9))  # rows of the table, in N
MOST = 0.9  # smallest share of the forces that counts as nearly all


def measure(resources: Resources) -> Findings:
    """Compare the standard deviations of both networks along the sweep."""
    larger = force_sweep(resources.predicted_loads(LARGER, SWEEP))
    smaller = force_sweep(resources.predicted_loads(SMALLER, SWEEP))
    return Findings(
        tables=[ratio_table(larger, smaller)],
        claims=[more_uncertain(larger, smaller)],
        figures={
            "bands": (
                draw_bands(larger, smaller),
                "95 % bands (± 1.96 σ) of the vertical displacement of the corner under vertical "
                "forces there, by networks trained on larger and on smaller forces; dotted, the "
                "training ranges.",
            )
        },
    )


def ratio_table(larger: ForceSweep, smaller: ForceSweep) -> Table:
    """Table of standard deviations at several forces, and their ratio."""
    rows = []
    for force in FORCES:
        wide = larger.at(force, larger.std)
        narrow = smaller.at(force, smaller.std)
        rows.append((force, MM * wide, MM * narrow, narrow / wide))
    return Table(
        caption="Standard deviation σ of the vertical displacement of the corner, mean of both "
        "senses of the force, by networks trained on larger and on smaller forces (range in "
        "brackets).",
        head=(
            "force [N]",
            f"σ (±{larger.limit:g} N) [mm]",
            f"σ (±{smaller.limit:g} N) [mm]",
            "ratio",
        ),
        rows=tuple(rows),
    )


def more_uncertain(larger: ForceSweep, smaller: ForceSweep) -> Claim:
    """Test whether the network of the smaller range is more uncertain beyond it."""
    ratio = (smaller.std / larger.std)[smaller.outside]
    share = float((ratio > 1).mean())
    return Claim(
        what="A network trained on smaller forces is more uncertain at higher ones.",
        holds=share >= MOST,
        evidence=f"Its standard deviation is larger at {100 * share:.0f} % of the forces beyond "
        f"±{smaller.limit:g} N (≥ {100 * MOST:.0f} %), {np.median(ratio):.1f} times in the median.",
    )


@styled
def draw_bands(larger: ForceSweep, smaller: ForceSweep) -> Figure:
    """Draw the 95 % bands of both networks about their means over the force."""
    figure = make_figure(5.6, 3.4)
    axes = figure.subplots()
    for sweep, color in ((smaller, OTHER), (larger, NETWORK)):
        band = half_width(BAND) * sweep.std
        label = f"trained on ±{sweep.limit:g} N"
        axes.fill_between(sweep.force, -band, band, color=color, alpha=0.35, lw=0, label=label)
        for end in (-sweep.limit, sweep.limit):
            axes.axvline(end, color=color, ls="dotted", lw=0.9)
    axes.set_xlabel("vertical force at the corner [N]")
    axes.set_ylabel("95 % band of the vertical displacement [m]")
    axes.set_xlim(larger.force[0], larger.force[-1])
    legend_below(figure, columns=2)
    return figure


STUDY = Experiment(
    name="training-ranges",
    title="Uncertainty by the range of forces in training",
    labels=("overlap_intervals",),
    question="Is a network that was trained on smaller forces less certain about larger ones?",
    measure=measure,
    datasets=(SWEEP,),
    runs=(LARGER, SMALLER),
)
