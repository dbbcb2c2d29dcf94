"""Figures in the paper's manner: undeformed mesh grey, network blue, finite elements red."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from shared_schema.drawing.figure_style import (
    NETWORK,
    REFERENCE,
    UNDEFORMED,
    legend_below,
    make_figure,
    styled,
)
from shared_schema.drawing.mesh_drawing import Drawing, make_drawing
from surrogate.data.geometry import Geometry
from surrogate.evaluation.metrics import ErrorMeasures, node_errors

LOSSES = {"train_loss": ("training", NETWORK), "validation_loss": ("validation", REFERENCE)}
NODAL_ERROR = r"nodal error $\|U - u\|_2$ [mm]"
Array = NDArray[np.float64]


@styled
def deformed_meshes(geometry: Geometry, predicted: Array, reference: Array, force: Array) -> Figure:
    """Undeformed mesh, network's and finite elements' deformed meshes over each other.

    Parameters
    ----------
    geometry : Geometry
    predicted, reference : array, (n_nodes, d)
        Displacements in m.
    force : array, (n_nodes, d)
        Nodal forces in N, drawn as arrows at the deformed nodes.
    """
    figure = make_figure(6.4, 3.6)
    drawing = make_drawing(figure, geometry)
    _draw_meshes(drawing, geometry, predicted, reference)
    drawing.forces(geometry.coordinates + reference, force)
    drawing.finish()
    legend_below(figure, columns=3)
    return figure


@styled
def close_up(
    geometry: Geometry, predicted: Array, reference: Array, nodes: NDArray[np.int64], around: float
) -> Figure:
    """Both deformed meshes round some nodes, which are marked.

    Parameters
    ----------
    geometry : Geometry
    predicted, reference : array, (n_nodes, d)
        Displacements in m.
    nodes : array of int
    around : float
        How much above and below them is shown, in m; to the sides twice that.
    """
    figure = make_figure(6.4, 3.2)
    drawing = make_drawing(figure, geometry)
    drawing.markers((geometry.coordinates + reference)[nodes], "black", s=24)
    lower, upper = drawing.extent()
    _draw_deformed(drawing, geometry, predicted, reference, wide=1.8)
    room = np.array((2 * around, around))
    drawing.finish((lower - room, upper + room), labelled=False)
    legend_below(figure, columns=2)
    return figure


@styled
def nodal_field(geometry: Geometry, displacement: Array, values: Array, label: str) -> Figure:
    """Nodal values, interpolated over the elements, on a deformed mesh.

    Parameters
    ----------
    geometry : Geometry
    displacement : array, (n_nodes, d)
        In m.
    values : array, (n_nodes,)
    label : str
        What the values are, and their unit.
    """
    figure = make_figure(6.4, 3.6)
    drawing = make_drawing(figure, geometry)
    add_field(drawing, geometry.coordinates + displacement, values, label)
    drawing.finish()
    return figure


def error_field(geometry: Geometry, predicted: Array, reference: Array) -> Figure:
    """Nodal error ‖U − u‖₂, interpolated over the elements, on the network's deformed mesh."""
    return nodal_field(geometry, predicted, node_errors(predicted, reference) * 1e3, NODAL_ERROR)


@styled
def meshes_and_errors(
    geometry: Geometry, predicted: Array, reference: Array, force: Array
) -> Figure:
    """Figures `deformed_meshes` and `error_field` side by side."""
    figure = make_figure(9.6, 3.2)
    left, right = (make_drawing(figure, geometry, position) for position in (121, 122))
    _draw_meshes(left, geometry, predicted, reference)
    left.forces(geometry.coordinates + reference, force)
    left.finish()
    errors = node_errors(predicted, reference) * 1e3
    add_field(right, geometry.coordinates + predicted, errors, NODAL_ERROR)
    right.finish(left.extent() if geometry.dimension == 2 else None)
    legend_below(figure, columns=3)
    return figure


def _draw_meshes(drawing: Drawing, geometry: Geometry, predicted: Array, reference: Array) -> None:
    """Draw all three meshes; the lines are finer in space, where there are more."""
    drawing.undeformed(UNDEFORMED, "undeformed", linewidth=0.6)
    wide = 1.8 if geometry.dimension == 2 else 0.9
    _draw_deformed(drawing, geometry, predicted, reference, wide)


def _draw_deformed(
    drawing: Drawing, geometry: Geometry, predicted: Array, reference: Array, wide: float
) -> None:
    x = geometry.coordinates
    drawing.mesh(x + reference, REFERENCE, "finite elements", linewidth=wide)
    drawing.mesh(x + predicted, NETWORK, "U-Net", linewidth=0.45 * wide)


def add_field(drawing: Drawing, x: Array, values: Array, label: str) -> None:
    """Draw nodal values, interpolated over the elements, with a colour bar beside them.

    Parameters
    ----------
    drawing : Drawing
    x : array, (n_nodes, d)
        Where the nodes are drawn, in m.
    values : array, (n_nodes,)
    label : str
        What the values are, and their unit.
    """
    image = drawing.field(x, values)
    drawing.mesh(x, "white", None, linewidth=0.3)
    figure = drawing.axes.figure
    bar = figure.colorbar(image, ax=drawing.axes, shrink=0.8, pad=0.02)
    bar.set_label(label)
    bar.outline.set_visible(False)


@styled
def sorted_errors(moved: Array, errors: Array, measures: ErrorMeasures) -> Figure:
    """Mean error of each test sample over the displacement at its load, with the regression line.

    Parameters
    ----------
    moved : array, (M,)
        Displacement magnitude where the force is applied, in m.
    errors : array, (M,)
        e_m in m.
    measures : ErrorMeasures
    """
    figure = make_figure(5.6, 3.2)
    axes = figure.subplots()
    order = np.argsort(moved)
    axes.plot(moved[order], errors[order] * 1e3, "o", ms=2.6, mew=0, color=NETWORK, alpha=0.7)
    line = measures.intercept + measures.slope * moved[order]
    label = rf"regression line, slope ${measures.slope * 1e3:.2f}\times10^{{-3}}$"
    axes.plot(moved[order], line * 1e3, color=REFERENCE, label=label)
    axes.axhline(measures.mean_error * 1e3, color="0.4", lw=0.8, ls="dashed")
    axes.annotate(
        rf"$\bar e = {measures.mean_error * 1e3:.3f}$ mm",
        xy=(1.0, measures.mean_error * 1e3),
        xycoords=("axes fraction", "data"),
        xytext=(0, 3),
        textcoords="offset points",
        ha="right",
        fontsize=9,
        color="0.3",
    )
    axes.set_xlabel("displacement magnitude at the loaded node [m]")
    axes.set_ylabel(r"mean error $e_m$ [mm]")
    axes.set_xlim(left=0)
    axes.set_ylim(bottom=0)
    axes.legend(loc="upper left")
    return figure


@styled
def loss_curves(curves: Mapping[str, Sequence[Mapping[str, Any]]]) -> Figure:
    """Training and validation loss over the epochs; logarithmic unless one becomes negative.

    Parameters
    ----------
    curves : dict of str to list of dict
        Lines of ``metrics.jsonl`` by the titles of their panels, which share the ordinate.
    """
    figure = make_figure(2.4 + 3.2 * len(curves), 3.2)
    places = {"wspace": 0.08}
    panels = figure.subplots(1, len(curves), sharey=True, squeeze=False, gridspec_kw=places)[0]
    drawn: list[float] = []
    for axes, (title, lines) in zip(panels, curves.items(), strict=True):
        epochs = [line["epoch"] for line in lines]
        for key, (name, color) in LOSSES.items():
            if key in lines[0]:
                losses = [line[key] for line in lines]
                axes.plot(epochs, losses, color=color, label=name)
                drawn += losses
        axes.set_title(title, fontsize=10)
        axes.set_xlabel("epoch")
        axes.set_xlim(0, epochs[-1])
        axes.grid(axis="y", which="major", color="0.9", lw=0.6)
        axes.legend()
    panels[0].set_ylabel("loss, scaled")
    if min(drawn) > 0:
        panels[0].set_yscale("log")
    return figure
