"""Figures of predicted uncertainty beside the errors made, in the style of the other figures."""

from __future__ import annotations

import numpy as np
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from numpy.typing import NDArray

from shared_schema.figure_style import NETWORK, REFERENCE, legend_below, make_figure, styled
from surrogate.calibration import CalibrationMeasures
from surrogate.figures import nodal_field
from surrogate.geometry import Geometry

Array = NDArray[np.float64]

CURVES = (NETWORK, REFERENCE, "#2a7f3f", "#d98a00", "#7a3fa0")  # colours, again from the first
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
    axes.set_ylabel(r"nodal error $\|U - u\|_2$ [mm]")
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
