"""Loads on nodes that were never loaded in the training (Figure "training_away")."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from shared_schema.figure_style import NETWORK, make_figure, styled
from surrogate import figures
from surrogate.calibration import half_width
from surrogate.extrapolation import BAND, Extrapolation
from surrogate.studies.accuracy import MM
from surrogate.studies.errors_by_distance import ErrorsByDistance
from surrogate.studies.record import Claim, Table
from surrogate.studies.study import Outcome, Study
from surrogate.studies.workshop import Workshop
from surrogate.uncertainty_figures import CURVES

RUNS, LOADS = ("beam2d-det", "beam2d-vb"), "beam2d_away"
TWO_ORDERS = 10**1.5, 10**2.5  # from here to there: two orders of magnitude, rounded
Array = NDArray[np.float64]


@styled
def errors_over_nodes(deterministic: ErrorsByDistance, bayesian: ErrorsByDistance) -> Figure:
    """Draw errors of both networks, and the predicted σ, over the number of the loaded node."""
    figure = make_figure(6.4, 3.4)
    axes = figure.subplots()
    nodes = np.arange(1, 1 + len(deterministic.order))
    for away, name, style in ((deterministic, "D", "solid"), (bayesian, "VB", "dashed")):
        for errors, kind, marker in (
            (away.max_error, "maximum", "^"),
            (away.mean_error, "mean", "o"),
        ):
            label = f"{kind} error ({name})"
            axes.plot(nodes, MM * errors, marker=marker, ms=4, color=NETWORK, ls=style, label=label)
    label = r"$\|\sigma\|_2$ at the loaded node (VB)"
    axes.plot(nodes, MM * bayesian.std, marker="s", ms=4, color=CURVES[2], label=label)
    axes.set_yscale("log")
    axes.set_xticks(nodes)
    axes.set_xlabel("loaded node of the free edge; the first was loaded in the training")
    axes.set_ylabel("error, standard deviation [mm]")
    axes.legend(bbox_to_anchor=(1.0, 0.5), loc="center left")
    return figure


def conduct(workshop: Workshop) -> Outcome:
    """Measure errors of both networks under each load, and show those at the 2nd and last node."""
    loads = workshop.predicted_loads(RUNS[0], LOADS)
    d, vb = ErrorsByDistance(loads), ErrorsByDistance(workshop.predicted_loads(RUNS[1], LOADS))
    columns = (d.mean_error, d.max_error, vb.mean_error, vb.max_error, vb.error, vb.std)
    values = np.stack(columns, axis=1) * MM
    rows = [
        (number, float(distance), *map(float, row))
        for number, (distance, row) in enumerate(zip(d.distance, values, strict=True), 1)
    ]
    head = (
        "loaded node",
        "from the training line [m]",
        "mean error (D) [mm]",
        "maximum (D) [mm]",
        "mean error (VB) [mm]",
        "maximum (VB) [mm]",
        "error there (VB) [mm]",
        "‖σ‖₂ there (VB) [mm]",
    )
    caption = "Errors under the same vertical force on each node of the free edge."
    return Outcome(
        tables=[Table(caption=caption, head=head, rows=tuple(rows))],
        claims=[
            growth_claim(d.mean_error),
            drop_claim(d.mean_error, d.max_error),
            uncertainty_claim(vb.error, vb.std),
        ],
        figures={
            "errors": (
                errors_over_nodes(d, vb),
                "Errors under a load on each node of the free edge, and the standard deviation "
                "that variational Bayes predicts at the loaded node.",
            ),
            "second": (meshes(loads, d.order[1]), "Load on the second node, deterministic U-Net."),
            "farthest": (
                meshes(loads, d.order[-1]),
                "Load on the node farthest from the training line, deterministic U-Net.",
            ),
        },
    )


def meshes(loads: Extrapolation, number: int) -> Figure:
    """Draw the deformed meshes of a sample."""
    predicted, samples = loads.predicted.mean[number], loads.samples
    return figures.deformed_meshes(
        loads.surrogate.geometry, predicted, samples.displacement[number], samples.force[number]
    )


def growth_claim(mean_error: Array) -> Claim:
    """Claim on e_m under the loads, from the training line outwards."""
    said = ", ".join(f"{MM * error:.3g}" for error in mean_error)
    return Claim(
        what="Errors increase from node to node when moving away from the training line.",
        holds=bool((np.diff(mean_error) > 0).all()),
        evidence=f"Mean errors of the deterministic U-Net in mm: {said}.",
    )


def drop_claim(mean_error: Array, max_error: Array) -> Claim:
    """Claim on how many times the errors grow."""
    factors = [float(errors.max() / errors[0]) for errors in (mean_error, max_error)]
    low, high = TWO_ORDERS
    return Claim(
        what="Accuracy drops by up to two orders of magnitude away from the training line.",
        holds=low <= max(factors) <= high,
        evidence=(
            f"The mean error grows {factors[0]:.0f} times, the maximum error {factors[1]:.0f} "
            f"times ({low:.0f} to {high:.0f})."
        ),
        better=max(factors) < low,
    )


def uncertainty_claim(error: Array, std: Array) -> Claim:
    """Claim on nodal error and σ at the loaded node, from the training line outwards."""
    ratio, limit = error / std, half_width(BAND)
    return Claim(
        what="The uncertainty of variational Bayes is not reliable away from the training line.",
        holds=bool(ratio[-1] > limit),
        evidence=(
            f"At the farthest node the error is {ratio[-1]:.3g} σ (> {limit:.3g}), at the first "
            f"{ratio[0]:.3g} σ; from there to here σ grows {std[-1] / std[0]:.0f} times, the error "
            f"{error[-1] / error[0]:.0f} times."
        ),
        better=True,
    )


STUDY = Study(
    name="loads-away",
    title="Loads away from the training line",
    labels=("fig: training_away",),
    question="What do networks predict under loads on nodes that were never loaded in training?",
    conduct=conduct,
    datasets=(LOADS,),
    runs=RUNS,
)
