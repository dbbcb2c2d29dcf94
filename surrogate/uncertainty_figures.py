"""Figures of predicted uncertainty beside the errors made, in the style of the other figures."""

from __future__ import annotations

import numpy as np
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from numpy.typing import NDArray

from shared_schema.figure_style import NETWORK, REFERENCE, legend_below, make_figure, styled
from surrogate.calibration import CalibrationMeasures, half_width
from surrogate.extrapolation import BAND, Extrapolation
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


@styled
def sweep(extrapolation: Extrapolation) -> Figure:
    """Displacement under a sweep of forces at one node, beside its uncertainty and error.

    Both at the loaded node, in the direction of the force; grey, the forces of the training.
    """
    surrogate, node = extrapolation.surrogate, extrapolation.node
    assert node is not None
    force = extrapolation.samples.force[:, node]
    axis = int(np.abs(force).max(axis=0).argmax())
    order = np.argsort(force[:, axis])
    x = force[order, axis]
    mean, std, epistemic, reference = (
        values[order, node, axis]
        for values in (
            extrapolation.predicted.mean,
            extrapolation.predicted.std,
            extrapolation.predicted.std_epistemic,
            extrapolation.samples.displacement,
        )
    )
    band = half_width(BAND)
    figure = make_figure(8.0, 3.2)
    left, right = figure.subplots(1, 2)
    limit = surrogate.description.data.info.force.max_abs[axis]
    for axes in (left, right):
        axes.axvspan(-limit, limit, color="0.93", lw=0)
        axes.set_xlabel(f"force component {'xyz'[axis]} at the node [N]")
    left.plot(x, reference, color=REFERENCE, lw=1.8, label="finite elements")
    left.plot(x, mean, color=NETWORK, lw=0.9, label="U-Net")
    left.fill_between(
        x, mean - band * std, mean + band * std, color=NETWORK, alpha=0.2, lw=0, label="95 % band"
    )
    left.set_ylabel(f"displacement component {'xyz'[axis]} [m]")
    left.legend()
    right.fill_between(x, -band * std * 1e3, band * std * 1e3, color=NETWORK, alpha=0.2, lw=0)
    right.plot(x, epistemic * 1e3, color=NETWORK, ls="dashed", lw=0.9, label="epistemic σ")
    right.plot(x, (mean - reference) * 1e3, color=REFERENCE, label="error")
    right.set_ylabel("error and 95 % band [mm]")
    right.legend()
    return figure
