"""Figures of the errors on the test split, over displacement and over predicted uncertainty."""

from __future__ import annotations

import numpy as np
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from numpy.typing import NDArray

from shared_schema.common.drawing.figure_style import NETWORK, REFERENCE, make_figure, styled
from shared_schema.common.units import SI, Units
from surrogate.figures.field_figures import NODAL_ERROR, NODAL_STD
from surrogate.learning.measures.error_metrics import ErrorMeasures

COUNTS = LinearSegmentedColormap.from_list("counts", ["#c3d2f5", NETWORK, "#0a1a45"])
Array = NDArray[np.float64]


@styled
def error_over_displacement(
    moved: Array, errors: Array, measures: ErrorMeasures, units: Units = SI
) -> Figure:
    """Draw the mean error of each sample over the displacement at its load, with regression line.

    Parameters
    ----------
    moved : array, (M,)
        Displacement magnitude at the loaded node in m.
    errors : array, (M,)
        Mean error e_m of each sample in m.
    measures : ErrorMeasures
    units : Units
        Labels of the units of both.
    """
    unit, factor = units.drawn(errors)
    figure = make_figure(5.6, 3.2)
    axes = figure.subplots()
    order = np.argsort(moved)
    axes.plot(moved[order], errors[order] * factor, "o", ms=2.6, mew=0, color=NETWORK, alpha=0.7)
    line = measures.intercept + measures.slope * moved[order]
    label = rf"regression line, slope ${measures.slope * 1e3:.2f}\times10^{{-3}}$"
    axes.plot(moved[order], line * factor, color=REFERENCE, label=label)
    axes.axhline(measures.mean_error * factor, color="0.4", lw=0.8, ls="dashed")
    axes.annotate(
        rf"$\bar e = {measures.mean_error * factor:#.3g}$ {unit}",
        xy=(1.0, measures.mean_error * factor),
        xycoords=("axes fraction", "data"),
        xytext=(0, 3),
        textcoords="offset points",
        ha="right",
        fontsize=9,
        color="0.3",
    )
    axes.set_xlabel(f"displacement magnitude at the loaded node [{units.length}]")
    axes.set_ylabel(rf"mean error $e_m$ [{unit}]")
    axes.set_xlim(left=0)
    axes.set_ylim(bottom=0)
    axes.legend(loc="upper left")
    return figure


@styled
def error_over_uncertainty(std: Array, errors: Array, units: Units = SI) -> Figure:
    """Draw how many nodes have which error and which standard deviation, both as 2-norms.

    Parameters
    ----------
    std, errors : array, (..., n_nodes, d)
        σ and U − u in m. Nodes where either is zero are left out: the axes are logarithmic.
    units : Units
        Labels of the units of both.
    """
    x = np.linalg.norm(std, axis=-1)
    y = np.linalg.norm(errors, axis=-1)
    shown = (x > 0) & (y > 0)
    unit, factor = units.drawn(x, y)
    x, y = factor * x, factor * y
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
    axes.set_xlabel(f"{NODAL_STD} [{unit}]")
    axes.set_ylabel(f"{NODAL_ERROR} [{unit}]")
    axes.legend(loc="upper left")
    bar = figure.colorbar(image, ax=axes, shrink=0.8, pad=0.02)
    bar.set_label("nodes")
    bar.outline.set_visible(False)
    return figure
