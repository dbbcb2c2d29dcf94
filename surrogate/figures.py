"""Figures in the paper's manner: undeformed mesh grey, network blue, finite elements red."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.tri import Triangulation
from numpy.typing import NDArray

from surrogate.geometry import Geometry
from surrogate.likelihoods import Loss
from surrogate.metrics import ErrorMeasures, node_errors

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")

UNDEFORMED, NETWORK, REFERENCE = "0.65", "#1f4fbf", "#c8202f"
STYLE: Any = {
    "font.family": "serif",
    "font.serif": ["STIXGeneral", "DejaVu Serif"],
    "mathtext.fontset": "stix",
    "font.size": 10,
    "axes.linewidth": 0.6,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "legend.frameon": False,
    "lines.linewidth": 1.2,
}
DPI = 200
LOSS_NAMES: dict[Loss, str] = {"mse": "mean squared error", "mae": "mean absolute error"}
Array = NDArray[np.float64]

EDGES = {  # corners of each edge of a cell, VTK order
    "triangle": ((0, 1), (1, 2), (2, 0)),
    "quad": ((0, 1), (1, 2), (2, 3), (3, 0)),
}


def styled(draw: Callable[Arguments, Result]) -> Callable[Arguments, Result]:
    """Make a function draw in the style of this module, whatever the user's settings are."""

    @wraps(draw)
    def wrapper(*args: Arguments.args, **kwargs: Arguments.kwargs) -> Result:
        with matplotlib.rc_context(STYLE):
            return draw(*args, **kwargs)

    return wrapper


@styled
def save(figure: Figure, path: Path) -> None:
    """Write a figure as PNG (or whatever the name ends in)."""
    figure.savefig(path, dpi=DPI, bbox_inches="tight")


@styled
def deformed_meshes(geometry: Geometry, predicted: Array, reference: Array, force: Array) -> Figure:
    """Undeformed mesh, network's and finite elements' deformed meshes over each other.

    Parameters
    ----------
    geometry : Geometry
        In two dimensions.
    predicted, reference : array, (n_nodes, d)
        Displacements in m.
    force : array, (n_nodes, d)
        Nodal forces in N, drawn as arrows that end at the deformed node.
    """
    figure, axes = _plane_figure()
    x = geometry.coordinates
    draw_mesh(axes, geometry, x, UNDEFORMED, "undeformed", linestyle="dashed", linewidth=0.6)
    draw_mesh(axes, geometry, x + reference, REFERENCE, "finite elements", linewidth=1.8)
    draw_mesh(axes, geometry, x + predicted, NETWORK, "U-Net", linewidth=0.8)
    _draw_forces(axes, x + reference, force)
    _finish_plane(axes)
    figure.legend(loc="outside lower center", ncols=3)
    return figure


def _draw_forces(axes: Axes, x: Array, force: Array) -> None:
    """Draw an arrow of fixed length for each loaded node, ending at it, with its magnitude."""
    length = 0.16 * float(np.ptp(x, axis=0).max())
    for node in np.flatnonzero(force.any(axis=1)):
        magnitude = float(np.linalg.norm(force[node]))
        head, tail = x[node], x[node] - length * force[node] / magnitude
        axes.update_datalim([tail, (tail[0] + 0.6 * length, tail[1])])
        axes.annotate(
            "",
            xy=tuple(head),
            xytext=tuple(tail),
            arrowprops={"arrowstyle": "-|>", "color": "black", "lw": 1.0, "shrinkA": 0},
        )
        axes.annotate(
            f"{magnitude:.2f} N",
            xy=tuple(tail),
            xytext=(4, 0),
            textcoords="offset points",
            va="center",
        )


@styled
def error_field(geometry: Geometry, predicted: Array, reference: Array) -> Figure:
    """Nodal error ‖U − u‖₂, interpolated over the elements, on the network's deformed mesh."""
    figure, axes = _plane_figure()
    x = geometry.coordinates + predicted
    errors = node_errors(predicted, reference) * 1e3
    triangles, values = _triangulate(geometry, x, errors)
    image = axes.tripcolor(triangles, values, shading="gouraud", cmap="viridis", rasterized=True)
    draw_mesh(axes, geometry, x, "white", None, linewidth=0.3)
    _finish_plane(axes)
    bar = figure.colorbar(image, ax=axes, shrink=0.8, pad=0.02)
    bar.set_label(r"nodal error $\|U - u\|_2$ [mm]")
    bar.outline.set_visible(False)
    return figure


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
    figure, axes = _figure(5.6, 3.2)
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
def loss_curves(lines: list[dict[str, Any]], loss: Loss) -> Figure:
    """Training and validation loss over the epochs, logarithmic."""
    figure, axes = _figure(5.6, 3.2)
    epochs = [line["epoch"] for line in lines]
    axes.semilogy(epochs, [line["train_loss"] for line in lines], color=NETWORK, label="training")
    if "validation_loss" in lines[0]:
        values = [line["validation_loss"] for line in lines]
        axes.semilogy(epochs, values, color=REFERENCE, label="validation")
    axes.set_xlabel("epoch")
    axes.set_ylabel(f"{LOSS_NAMES[loss]}, scaled")
    axes.set_xlim(0, epochs[-1])
    axes.grid(axis="y", which="major", color="0.9", lw=0.6)
    axes.legend()
    return figure


def draw_mesh(
    axes: Axes, geometry: Geometry, x: Array, color: str, label: str | None, **style: Any
) -> None:
    """Draw every edge of a plane mesh once, its nodes at `x` (n_nodes, 2) in m."""
    edges = np.concatenate([geometry.cells[:, pair] for pair in EDGES[geometry.cell_type]])
    unique = np.unique(np.sort(edges, axis=1), axis=0)
    axes.add_collection(LineCollection(list(x[unique]), colors=color, label=label, **style))


def _triangulate(geometry: Geometry, x: Array, values: Array) -> tuple[Triangulation, Array]:
    """Triangles for smooth shading; a quadrilateral becomes four, which meet at its centre."""
    cells = geometry.cells
    if geometry.cell_type != "quad":
        return Triangulation(x[:, 0], x[:, 1], cells), values
    centre = len(x) + np.arange(len(cells))
    x = np.concatenate((x, x[cells].mean(axis=1)))
    values = np.concatenate((values, values[cells].mean(axis=1)))
    corners = [np.stack((cells[:, a], cells[:, b], centre), axis=1) for a, b in EDGES["quad"]]
    return Triangulation(x[:, 0], x[:, 1], np.concatenate(corners)), values


def _figure(width: float, height: float) -> tuple[Figure, Axes]:
    figure = Figure(figsize=(width, height), layout="constrained")
    return figure, figure.subplots()


def _plane_figure() -> tuple[Figure, Axes]:
    return _figure(6.4, 3.6)


def _finish_plane(axes: Axes) -> None:
    axes.set_aspect("equal")
    axes.autoscale_view()
    axes.margins(0.04)
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")
