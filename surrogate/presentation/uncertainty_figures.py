"""Figures of predicted uncertainty beside the errors made, in the style of the other figures."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from numpy.typing import NDArray

from shared_schema.drawing.figure_style import NETWORK, REFERENCE, legend_below, make_figure, styled
from shared_schema.drawing.mesh_drawing import make_drawing
from surrogate.data.geometry import Geometry
from surrogate.evaluation.extrapolation import BAND, Extrapolation
from surrogate.evaluation.force_sweep import force_sweep
from surrogate.evaluation.metrics import node_errors
from surrogate.presentation.figures import NODAL_ERROR, add_field, nodal_field
from surrogate.uncertainty.calibration import CalibrationMeasures, half_width

Array = NDArray[np.float64]

OTHER = "#2a7f3f"  # a second network
CURVES = (NETWORK, REFERENCE, OTHER, "#d98a00", "#7a3fa0")  # colours, again from the first
COUNTS = LinearSegmentedColormap.from_list("counts", ["#c3d2f5", NETWORK, "#0a1a45"])
NODAL_STD = r"nodal standard deviation $\|\sigma\|_2$ [mm]"


@styled
def calibration_curve(measures_by_name: dict[str, CalibrationMeasures]) -> Figure:
    """Observed coverage of central intervals over their expected level, a curve for every name."""
    figure = make_figure(3.6, 3.6)
    axes = figure.subplots()
    axes.set_prop_cycle(color=CURVES)
    axes.plot([0, 1], [0, 1], color="0.4", lw=0.8, ls="dashed")
    for name, measures in measures_by_name.items():
        label = f"{name}, area {measures.miscalibration_area:.3f}"
        axes.plot(measures.levels, measures.observed, label=label)
    axes.set_xlabel("expected level of central intervals")
    axes.set_ylabel("observed coverage")
    axes.set_xlim(0, 1)
    axes.set_ylim(0, 1)
    axes.set_aspect("equal")
    legend_below(figure, columns=1)
    return figure


@styled
def error_against_uncertainty(std: Array, errors: Array) -> Figure:
    """Error over standard deviation of every node, 2-norms, as numbers of nodes.

    Parameters
    ----------
    std, errors : array, (..., n_nodes, d)
        σ and U − u in m. Nodes without either, the clamped ones, have no place on logarithmic axes.
    """
    x, y = (np.linalg.norm(values, axis=-1) * 1e3 for values in (std, errors))
    shown = (x > 0) & (y > 0)
    figure = make_figure(4.8, 3.6)
    axes = figure.subplots()
    image = axes.hexbin(
        x[shown],
        y[shown],
        xscale="log",
        yscale="log",
        bins="log",
        gridsize=50,
        mincnt=1,
        cmap=COUNTS,
        lw=0,
    )
    ends = np.array([x[shown].min(), x[shown].max()])
    axes.plot(ends, ends, color=REFERENCE, label=r"$\|\sigma\|_2$")
    axes.plot(ends, 2 * ends, color=REFERENCE, ls="dashed", label=r"$2\,\|\sigma\|_2$")
    axes.set_xlabel(NODAL_STD)
    axes.set_ylabel(NODAL_ERROR)
    axes.legend(loc="upper left")
    bar = figure.colorbar(image, ax=axes, shrink=0.8, pad=0.02)
    bar.set_label("nodes")
    bar.outline.set_visible(False)
    return figure


def uncertainty_field(geometry: Geometry, mean: Array, std: Array) -> Figure:
    """Nodal ‖σ‖₂, interpolated over the elements, on the mean deformed mesh.

    Parameters
    ----------
    geometry : Geometry
    mean, std : array, (n_nodes, d)
        μ and σ in m.
    """
    return nodal_field(geometry, mean, np.linalg.norm(std, axis=1) * 1e3, NODAL_STD)


@styled
def error_beside_uncertainty(
    geometry: Geometry, force: Array, mean: Array, std: Array, reference: Array
) -> Figure:
    """Nodal error and nodal ‖σ‖₂ on the mean deformed mesh; over the error, the equilibrium.

    Parameters
    ----------
    geometry : Geometry
    force : array, (n_nodes, d)
        In N.
    mean, std, reference : array, (n_nodes, d)
        μ, σ and u in m.
    """
    figure = make_figure(10.0, 3.2)
    x = geometry.coordinates
    left, right = (make_drawing(figure, geometry, position) for position in (121, 122))
    add_field(left, x + mean, node_errors(mean, reference) * 1e3, NODAL_ERROR)
    left.mesh(x + reference, REFERENCE, "finite elements", linewidth=0.6)
    left.forces(x + mean, force)
    add_field(right, x + mean, np.linalg.norm(std, axis=1) * 1e3, NODAL_STD)
    left.finish()
    right.finish(left.extent())
    legend_below(figure, columns=1)
    return figure


@styled
def sweep(
    extrapolation: Extrapolation,
    deterministic: Extrapolation | None = None,
    name: str = "prediction",
) -> Figure:
    """Displacement under a sweep of forces at one node, beside its error and uncertainty.

    Both at the loaded node, in the direction of the force; grey, the forces of the training. Errors
    are drawn linearly up to σ inside the training range, and logarithmically beyond.

    Parameters
    ----------
    extrapolation : Extrapolation
    deterministic : Extrapolation, optional
        Of a deterministic network under the same forces, to be drawn as well.
    name : str
        What the prediction is called.
    """
    network = force_sweep(extrapolation)
    x, mean, band = network.force, network.mean, half_width(BAND) * network.std
    figure = make_figure(8.0, 3.2)
    left, right = figure.subplots(1, 2)
    for axes in (left, right):
        axes.axvspan(-network.limit, network.limit, color="0.93", lw=0)
        axes.set_xlabel(f"force component {'xyz'[network.axis]} at the node [N]")
    shade: dict[str, Any] = {"color": NETWORK, "alpha": 0.2, "lw": 0}
    left.fill_between(x, mean - band, mean + band, label="95 % band", **shade)
    left.plot(x, network.reference, color=REFERENCE, lw=1.8, label="finite elements")
    left.plot(x, mean, color=NETWORK, lw=0.9, label=name)
    left.set_ylabel(f"displacement component {'xyz'[network.axis]} [m]")
    right.fill_between(x, -band * 1e3, band * 1e3, **shade)
    epistemic = network.std_epistemic * 1e3
    right.plot(x, epistemic, color=NETWORK, ls="dotted", lw=0.9, label="epistemic σ")
    right.plot(x, network.error * 1e3, color=NETWORK)
    right.set_ylabel("error and 95 % band [mm]")
    if deterministic is not None:
        other = force_sweep(deterministic)
        style = {"color": OTHER, "ls": "dashed"}
        left.plot(other.force, other.mean, label="U-Net (D)", **style)
        right.plot(other.force, other.error * 1e3, **style)
    inside = network.std[~network.outside].max(initial=network.std.min())
    scale_from_zero(right, float(inside) * 1e3)
    legend_below(figure, columns=5)
    return figure


def scale_from_zero(axes: Axes, linear: float) -> None:
    """Scale an ordinate linearly up to about ± `linear`, logarithmically beyond, with few ticks."""
    linear = float(f"{linear:.0e}")
    largest = np.abs(axes.get_ylim()).max()
    decades = linear * 10.0 ** np.arange(1 + max(0, math.floor(math.log10(largest / linear))))
    ticks = (*-decades[::-1], 0.0, *decades)
    axes.set_yscale("symlog", linthresh=linear)
    axes.minorticks_off()
    axes.set_yticks(ticks, [f"{tick:g}".replace("-", "−") for tick in ticks])
