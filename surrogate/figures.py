"""Figures in the paper's manner: undeformed mesh grey, network blue, finite elements red."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

import matplotlib
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from surrogate.geometry import Geometry
from surrogate.likelihoods import Loss
from surrogate.mesh_drawing import make_drawing
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
    predicted, reference : array, (n_nodes, d)
        Displacements in m.
    force : array, (n_nodes, d)
        Nodal forces in N, drawn as arrows that end at the deformed node.
    """
    figure = _figure(6.4, 3.6)
    drawing = make_drawing(figure, geometry)
    x = geometry.coordinates
    drawing.mesh(x, UNDEFORMED, "undeformed", linestyle="dashed", linewidth=0.6)
    drawing.mesh(x + reference, REFERENCE, "finite elements", linewidth=1.8)
    drawing.mesh(x + predicted, NETWORK, "U-Net", linewidth=0.8)
    drawing.forces(x + reference, force)
    drawing.finish()
    figure.legend(loc="outside lower center", ncols=3)
    return figure


@styled
def error_field(geometry: Geometry, predicted: Array, reference: Array) -> Figure:
    """Nodal error ‖U − u‖₂, interpolated over the elements, on the network's deformed mesh."""
    figure = _figure(6.4, 3.6)
    drawing = make_drawing(figure, geometry)
    x = geometry.coordinates + predicted
    image = drawing.field(x, node_errors(predicted, reference) * 1e3)
    drawing.mesh(x, "white", None, linewidth=0.3)
    drawing.finish()
    bar = figure.colorbar(image, ax=figure.axes[0], shrink=0.8, pad=0.02)
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
    figure = _figure(5.6, 3.2)
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
def loss_curves(lines: list[dict[str, Any]], loss: Loss) -> Figure:
    """Training and validation loss over the epochs, logarithmic."""
    figure = _figure(5.6, 3.2)
    axes = figure.subplots()
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


def _figure(width: float, height: float) -> Figure:
    return Figure(figsize=(width, height), layout="constrained")
