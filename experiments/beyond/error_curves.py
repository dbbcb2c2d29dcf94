"""Figure of curves over a common abscissa, one panel a body, narrow enough for a telephone."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure

from experiments.beyond.networks import Kind
from shared_schema.common.drawing import make_figure, styled

WIDTH, HEIGHT = 4.2, 2.5  # of a panel, in inches
MOST_TICKS = 8  # whole numbers on the abscissa that are ticked one by one
FLOOR = 1e-12  # smallest value on a logarithmic axis


class Curve(NamedTuple):
    """A curve: abscissae, ordinates, kind of network, line style and label (its kind's if None)."""

    x: Sequence[float]
    y: Sequence[float]
    kind: Kind
    style: str = "-"
    label: str | None = None


@styled
def draw_curves(
    panels: Mapping[str, Sequence[Curve]],
    across: str,
    up: str,
    trained: Mapping[str, tuple[float, float]] | None = None,
    log: tuple[bool, bool] = (False, True),
    markers: bool = True,
) -> Figure:
    """Draw curves below each other, a panel a body, with one legend for all.

    Parameters
    ----------
    panels : mapping of str to sequence of Curve
        Curves by the name of the body.
    across, up : str
        Labels of the axes, with units.
    trained : mapping of str to (float, float), optional
        Interval of the abscissa that the training covers by the name of the body; shaded.
    log : tuple of bool
        Logarithmic abscissa, and ordinate.
    markers : bool
        Mark the points.
    """
    figure = make_figure(WIDTH, HEIGHT * max(1, len(panels)))
    handles: dict[str, Any] = {}
    axes_of = figure.subplots(max(1, len(panels)), 1, squeeze=False)[:, 0]
    for axes, (body, curves) in zip(axes_of, panels.items(), strict=False):
        for curve in curves:
            kind, style = curve.kind, f"{curve.kind.marker if markers else ''}{curve.style}"
            y = np.maximum(curve.y, FLOOR) if log[1] else curve.y
            (line,) = axes.plot(curve.x, y, style, color=kind.color, ms=4)
            handles.setdefault(curve.label or kind.label, line)
        if trained and body in trained:
            axes.axvspan(*trained[body], color="0.93", lw=0, zorder=0)
        axes.set_xscale("log" if log[0] else "linear")
        axes.set_yscale("log" if log[1] else "linear")
        places = np.unique([x for curve in curves for x in curve.x])
        if len(places) <= MOST_TICKS and (places == places.round()).all():
            axes.set_xticks(places, [f"{x:g}" for x in places], minor=False)
            axes.xaxis.minorticks_off()
        axes.set_title(body, fontsize=10)
        axes.set_ylabel(up)
    axes_of[-1].set_xlabel(across)
    figure.legend(
        list(handles.values()),
        list(handles),
        loc="upper center",
        bbox_to_anchor=(0.5, 0.0),
        ncols=2,
        fontsize=9,
    )
    return figure
