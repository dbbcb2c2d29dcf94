"""Figure of the displacement, error and uncertainty under a sweep of forces at one node."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from shared_schema.common.drawing.figure_style import (
    NETWORK,
    REFERENCE,
    legend_below,
    make_figure,
    styled,
)
from shared_schema.common.units import SI, Units
from surrogate.figures.curve_colours import OTHER
from surrogate.learning.measures.extrapolation import BAND, Extrapolation
from surrogate.learning.measures.force_sweep import force_sweep
from surrogate.learning.probabilistic.calibration import half_width


@styled
def sweep_curves(
    extrapolation: Extrapolation,
    deterministic: Extrapolation | None = None,
    name: str = "prediction",
    units: Units = SI,
) -> Figure:
    """Draw the displacement under a sweep of forces at one node, and its error and uncertainty.

    Both are taken at the loaded node in the direction of the force; the training range is shaded
    grey. The error axis is linear up to the largest σ inside that range, and logarithmic beyond.

    Parameters
    ----------
    extrapolation : Extrapolation
    deterministic : Extrapolation, optional
        Predictions of a deterministic network under the same forces, drawn as well.
    name : str
        Name of the prediction in the legend.
    units : Units
        Labels of the units of forces and displacements.
    """
    network = force_sweep(extrapolation)
    x, mean, band = network.force, network.mean, half_width(BAND) * network.std
    figure = make_figure(8.0, 3.2)
    left, right = figure.subplots(1, 2)
    for axes in (left, right):
        axes.axvspan(-network.limit, network.limit, color="0.93", lw=0)
        axes.set_xlabel(f"force component {'xyz'[network.axis]} at the node [{units.force}]")
    shade: dict[str, Any] = {"color": NETWORK, "alpha": 0.2, "lw": 0}
    left.fill_between(x, mean - band, mean + band, label="95 % band", **shade)
    left.plot(x, network.reference, color=REFERENCE, lw=1.8, label="finite elements")
    left.plot(x, mean, color=NETWORK, lw=0.9, label=name)
    left.set_ylabel(f"displacement component {'xyz'[network.axis]} [{units.length}]")
    unit, factor = units.drawn(band, network.error)
    right.fill_between(x, -band * factor, band * factor, **shade)
    epistemic = network.std_epistemic * factor
    right.plot(x, epistemic, color=NETWORK, ls="dotted", lw=0.9, label="epistemic σ")
    right.plot(x, network.error * factor, color=NETWORK)
    right.set_ylabel(f"error and 95 % band [{unit}]")
    if deterministic is not None:
        other = force_sweep(deterministic)
        style = {"color": OTHER, "ls": "dashed"}
        left.plot(other.force, other.mean, label="U-Net (D)", **style)
        right.plot(other.force, other.error * factor, **style)
    inside = network.std[~network.outside].max(initial=network.std.min())
    scale_from_zero(right, float(inside) * factor)
    legend_below(figure, columns=5)
    return figure


def scale_from_zero(axes: Axes, linear: float) -> None:
    """Scale an ordinate linearly up to about ± `linear`, logarithmically beyond; tick decades."""
    linear = float(f"{linear:.0e}")
    largest = np.abs(axes.get_ylim()).max()
    decades = linear * 10.0 ** np.arange(1 + max(0, math.floor(math.log10(largest / linear))))
    ticks = (*-decades[::-1], 0.0, *decades)
    axes.set_yscale("symlog", linthresh=linear)
    axes.minorticks_off()
    axes.set_yticks(ticks, [f"{tick:g}".replace("-", "−") for tick in ticks])
