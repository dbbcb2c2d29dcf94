"""Figures of curves: loss over epochs, coverage over levels, errors over the force of a sweep."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter

from shared_schema.common.drawing.figure_style import (
    NETWORK,
    REFERENCE,
    legend_below,
    make_figure,
    styled,
)
from shared_schema.common.units import SI, Units
from surrogate.learning.measures.extrapolation import BAND, Extrapolation
from surrogate.learning.measures.force_sweep import force_sweep
from surrogate.learning.probabilistic.calibration import CalibrationMeasures, half_width

OTHER = "#2a7f3f"  # a second network
CURVES = (NETWORK, REFERENCE, OTHER, "#d98a00", "#7a3fa0")
LOSSES = {"train_loss": ("training", NETWORK), "validation_loss": ("validation", REFERENCE)}


def number_plainly(axis: Axis) -> None:
    """Write 0.1, 0.2, 0.5, 1, … at a logarithmic axis, and nothing between them."""
    axis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    axis.set_major_formatter("{x:g}")
    axis.set_minor_formatter(NullFormatter())


@styled
def calibration_curves(measures_by_name: dict[str, CalibrationMeasures]) -> Figure:
    """Draw the observed coverage of central intervals over their expected level, a curve a name."""
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
def loss_curves(curves: Mapping[str, Sequence[Mapping[str, Any]]]) -> Figure:
    """Draw training and validation loss over the epochs.

    The panels share their ordinate: logarithmic unless a loss is negative.

    Parameters
    ----------
    curves : dict of str to list of dict
        Lines of ``metrics.jsonl`` by the title of their panel.
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
