"""Loads on nodes that are not loaded in training (Figure "training_away")."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from experiments.framework.experiment import Experiment, Findings
from experiments.framework.record import Claim, Table
from experiments.framework.resources import Resources
from experiments.measures.errors_on_test_split import MM
from experiments.measures.vertical_force import describe_vertical_force
from shared_schema.common.drawing import NETWORK, make_figure, styled
from surrogate.figures import CURVES, deformed_meshes
from surrogate.learning.measures import Extrapolation, node_errors, sample_errors

RUNS, LOADS = ("beam2d-det", "beam2d-vb"), "beam2d_away"
TWO_ORDERS = 10**1.5  # smallest factor that counts as two orders of magnitude, rounded
LOW = 0.5  # share of the largest σ up to which σ counts as low
RELIABLE = 0.5  # share of components in their 95 % intervals below which σ is not reliable
SIGMA, BAYESIAN = CURVES[2:4]  # colours
Array = NDArray[np.float64]


@styled
def errors_over_nodes(
    deterministic: ErrorsByLoadDistance, bayesian: ErrorsByLoadDistance
) -> Figure:
    """Draw errors of both networks, and the predicted σ, over the number of the loaded node."""
    figure = make_figure(6.4, 3.4)
    axes = figure.subplots()
    nodes = np.arange(1, 1 + len(deterministic.order))
    for values, label, color, style in (
        (deterministic.max_error, "maximum error (D)", NETWORK, "^-"),
        (deterministic.mean_error, "mean error (D)", NETWORK, "o-"),
        (bayesian.max_error, "maximum error (VB)", BAYESIAN, "^--"),
        (bayesian.mean_error, "mean error (VB)", BAYESIAN, "o--"),
        (bayesian.error, r"$\|U - u\|_2$ at the loaded node (VB)", BAYESIAN, "s-"),
        (bayesian.std, r"$\|\sigma\|_2$ at the loaded node (VB)", SIGMA, "s-"),
    ):
        axes.plot(nodes, MM * values, style, ms=4, color=color, label=label)
    axes.set_yscale("log")
    axes.set_xticks(nodes)
    axes.set_xlabel("loaded node of the free edge; the first was loaded in the training")
    axes.set_ylabel("error, standard deviation [mm]")
    axes.legend(bbox_to_anchor=(1.0, 0.5), loc="center left")
    return figure


def measure(resources: Resources) -> Findings:
    """Measure errors of both networks under each load, and show those at the 2nd and last node."""
    loads = resources.predicted_loads(RUNS[0], LOADS)
    d = ErrorsByLoadDistance(loads)
    vb = ErrorsByLoadDistance(resources.predicted_loads(RUNS[1], LOADS))
    load = describe_vertical_force(loads.samples.force[d.order[0]])
    second = meshes(loads, d.order[1])
    farthest = meshes(loads, d.order[-1])
    share_view(second, farthest)
    return Findings(
        tables=[errors_table(d, vb, load)],
        claims=[
            growth_claim(d.mean_error),
            drop_claim(d.mean_error, d.max_error),
            uncertainty_claim(vb.covered, vb.error, vb.std),
            low_claim(vb.std),
        ],
        figures={
            "errors": (
                errors_over_nodes(d, vb),
                f"Errors under {load} on each node of the free edge; of variational Bayes also the "
                "error and the standard deviation at the loaded node.",
            ),
            "second": (second, f"{load} on the second node, deterministic U-Net."),
            "farthest": (
                farthest,
                f"{load} on the node farthest from the training line, deterministic U-Net.",
            ),
        },
    )


def errors_table(d: ErrorsByLoadDistance, vb: ErrorsByLoadDistance, load: str) -> Table:
    """Table of the errors of both networks under each load, which `load` describes."""
    columns = {
        "from the training line [m]": d.distance,
        "‖u‖₂ [m]": d.moved,
        "mean error (D) [mm]": MM * d.mean_error,
        "maximum (D) [mm]": MM * d.max_error,
        "mean error (VB) [mm]": MM * vb.mean_error,
        "maximum (VB) [mm]": MM * vb.max_error,
        "‖U − u‖₂ (VB) [mm]": MM * vb.error,
        "‖σ‖₂ (VB) [mm]": MM * vb.std,
    }
    rows = np.stack(list(columns.values()), axis=1).tolist()
    return Table(
        caption=f"Errors under {load} on each node of the free edge; ‖·‖₂ at the loaded node.",
        head=("loaded node", *columns),
        rows=tuple((number, *row) for number, row in enumerate(rows, start=1)),
    )


def meshes(loads: Extrapolation, number: int) -> Figure:
    """Draw the deformed meshes of a sample."""
    predicted, samples = loads.predicted.mean[number], loads.samples
    return deformed_meshes(
        loads.surrogate.geometry,
        predicted,
        samples.displacement[number],
        samples.force[number],
        "U-Net",
    )


def share_view(*drawn: Figure) -> None:
    """Set the same limits in all figures, wide enough for each of them."""
    views = np.array([(f.axes[0].get_xlim(), f.axes[0].get_ylim()) for f in drawn])
    lower, upper = views[..., 0].min(axis=0), views[..., 1].max(axis=0)
    for figure in drawn:
        figure.axes[0].set(xlim=(lower[0], upper[0]), ylim=(lower[1], upper[1]))


def growth_claim(mean_error: Array) -> Claim:
    """Claim on e_m under the loads, from the training line outwards."""
    return Claim(
        what="Errors increase from node to node when moving away from the training line.",
        holds=bool((np.diff(mean_error) > 0).all()),
        evidence=f"Mean errors of the deterministic U-Net in mm: {join_numbers(MM * mean_error)}.",
    )


def drop_claim(mean_error: Array, max_error: Array) -> Claim:
    """Claim on the growth factors of the errors."""
    factors = [float(errors.max() / errors[0]) for errors in (mean_error, max_error)]
    return Claim(
        what="Accuracy drops by two orders of magnitude away from the training line.",
        holds=max(factors) >= TWO_ORDERS,
        evidence=(
            f"The mean error grows {factors[0]:.0f} times, the maximum error {factors[1]:.0f} "
            f"times (at least {TWO_ORDERS:.0f})."
        ),
        better=True,
    )


def uncertainty_claim(covered: Array, error: Array, std: Array) -> Claim:
    """Claim on the share of components inside the 95 % band; ‖U − u‖₂ and ‖σ‖₂ as evidence."""
    return Claim(
        what="The uncertainty of variational Bayes is not reliable away from the training line.",
        holds=bool(covered[1:].max() < RELIABLE),
        evidence=(
            "Under the load on the first node, "
            f"{100 * covered[0]:.3g} % of the components of all free nodes are inside their 95 % "
            f"intervals, on the others {join_numbers(100 * covered[1:])} % (not reliable below "
            f"{100 * RELIABLE:g} %); from the first to the farthest node ‖σ‖₂ grows "
            f"{std[-1] / std[0]:.0f} times, ‖U − u‖₂ {error[-1] / error[0]:.0f} times."
        ),
        better=True,
    )


def low_claim(std: Array) -> Claim:
    """Claim on ‖σ‖₂ at the loaded node, from the training line outwards."""
    return Claim(
        what="The uncertainty should be largest under the load on the farthest node, but is low.",
        holds=bool(std[-1] <= LOW * std.max()),
        evidence=(
            f"‖σ‖₂ at the loaded node in mm: {join_numbers(MM * std)}; at the farthest "
            f"{100 * std[-1] / std.max():.3g} % of the largest (low up to {100 * LOW:g} %)."
        ),
        better=True,
    )


def join_numbers(numbers: Array) -> str:
    """Write numbers (N,) separated by commas."""
    return ", ".join(f"{number:.3g}" for number in numbers)


class ErrorsByLoadDistance:
    """Errors of a network under single loads, in the order of the distance of the load.

    Attributes
    ----------
    order : array of int, (M,)
        Numbers of the samples by the distance of the load from the nodes loaded in training. All
        arrays below are in this order.
    distance : array, (M,)
        Distance of the load in m.
    mean_error, max_error : array, (M,)
        Mean error e_m and largest error of a component, in m.
    moved, error, std : array, (M,)
        Norms ‖u‖₂, ‖U − u‖₂ and ‖σ‖₂ at the loaded node, in m.
    covered : array, (M,)
        Share of the components of all free nodes whose error is inside the 95 % band.
    """

    def __init__(self, loads: Extrapolation) -> None:
        geometry, samples, predicted = loads.surrogate.geometry, loads.samples, loads.predicted
        number = np.arange(len(samples.force))
        node = samples.force.any(axis=2).argmax(axis=1)
        x, trained = geometry.coordinates, geometry.coordinates[geometry.loadable]
        distance = np.linalg.norm(x[node][:, None] - trained, axis=2).min(axis=1)
        self.order = np.argsort(distance, kind="stable")
        self.distance = distance[self.order]
        mean, reference = predicted.mean[self.order], samples.displacement[self.order]
        self.mean_error = sample_errors(mean, reference)
        self.max_error = np.abs(mean - reference).max(axis=(1, 2))
        there = number, node[self.order]
        self.moved = np.linalg.norm(reference[there], axis=1)
        self.error = node_errors(mean, reference)[there]
        self.std = np.linalg.norm(predicted.std[self.order][there], axis=1)
        self.covered = loads.inside[self.order]


STUDY = Experiment(
    name="loads-away",
    title="Loads away from the training line",
    labels=("fig: training_away",),
    question="What do networks predict under loads on nodes that were never loaded in training?",
    measure=measure,
    datasets=(LOADS,),
    runs=RUNS,
)
