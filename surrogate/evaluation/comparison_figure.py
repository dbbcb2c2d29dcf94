"""Figure of several runs beside each other."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from shared_schema.common.drawing.figure_style import NETWORK, REFERENCE, make_figure, styled
from surrogate.evaluation.run_comparison import Compared
from surrogate.figures.plain_log_axis import number_plainly


@styled
def comparison_figure(runs: Sequence[Compared]) -> Figure:
    """Draw mean error, mean and standard deviation, and largest error of every run."""
    figure = make_figure(5.6, 1.1 + 0.32 * len(runs))
    axes = figure.subplots()
    places = np.arange(len(runs))[::-1]
    mean = 1e3 * np.array([run.mean_error for run in runs])
    std = 1e3 * np.array([run.std_error for run in runs])
    largest = 1e3 * np.array([run.max_error for run in runs])
    axes.hlines(places, mean, largest, color="0.8", lw=0.8)
    axes.plot(mean, places, "o", color=NETWORK, label=r"$\bar e$")
    axes.plot(mean + std, places, "|", ms=9, color=NETWORK, label=r"$\bar e + \sigma(e)$")
    axes.plot(largest, places, "x", ms=5, color=REFERENCE, label="largest of a component")
    axes.set_xscale("log")
    number_plainly(axes.xaxis)
    axes.set_xlabel("error on the test split [mm]")
    axes.set_yticks(places, [run.run for run in runs])
    axes.set_ylim(-0.6, len(runs) - 0.4)
    figure.legend(loc="outside upper center", ncols=3, fontsize=9)
    return figure
