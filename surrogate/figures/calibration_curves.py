"""Figure of calibration curves: observed coverage of central intervals over their level."""

from __future__ import annotations

from matplotlib.figure import Figure

from shared_schema.common.drawing.figure_style import legend_below, make_figure, styled
from surrogate.figures.curve_colours import CURVES
from surrogate.learning.probabilistic.calibration import CalibrationMeasures


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
