"""Figure of a learning curve."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from shared_schema.common.drawing.figure_style import NETWORK, make_figure, styled
from shared_schema.common.units import SI, Units
from surrogate.figures.plain_log_axis import number_plainly

if TYPE_CHECKING:
    from surrogate.learning.evaluation.learning_curves import Point, PowerLaw

BEYOND = 2  # ratio of the largest number on the axis and of the largest that was tried


@styled
def learning_curve_figure(
    points: Sequence[Point], law: PowerLaw | None, units: Units = SI
) -> Figure:
    """Draw the mean errors over the number of training samples, and the power law beyond them.

    Parameters
    ----------
    points : sequence of Point
    law : PowerLaw or None
    units : Units
        Labels of the units of the errors.
    """
    figure = make_figure(4.6, 3.0)
    axes = figure.subplots()
    samples = np.array([point.samples for point in points])
    errors = np.array([point.mean_error for point in points])
    unit, factor = units.drawn(errors)
    axes.plot(samples, factor * errors, "o", color=NETWORK, label=r"$\bar e$ on the test split")
    if law is not None:
        drawn = np.geomspace(samples[0], BEYOND * samples[-1], 50)
        label = rf"$\bar e \propto N^{{{-law.exponent:.2f}}}$, fitted"
        axes.plot(drawn, [factor * law.error(n) for n in drawn], "--", color="0.5", label=label)
    axes.set_xscale("log")
    axes.set_yscale("log")
    number_plainly(axes.xaxis)
    number_plainly(axes.yaxis)
    axes.set_xlabel("training samples N")
    axes.set_ylabel(f"mean error [{unit}]")
    axes.legend()
    return figure
