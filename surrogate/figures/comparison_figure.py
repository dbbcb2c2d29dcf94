"""Figure of several runs beside each other."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from shared_schema.common.drawing.figure_style import NETWORK, REFERENCE, make_figure, styled
from shared_schema.common.errors import InputError
from shared_schema.common.units import LENGTHS, Units
from surrogate.figures.curves import number_plainly

if TYPE_CHECKING:
    from surrogate.learning.evaluation.run_comparison import Compared


@styled
def comparison_figure(runs: Sequence[Compared]) -> Figure:
    """Draw mean error, mean and standard deviation, and largest error of every run.

    Raises
    ------
    InputError
        If errors are in different units, one of which is no unit of the metre.
    """
    figure = make_figure(5.6, 1.1 + 0.32 * len(runs))
    axes = figure.subplots()
    places = np.arange(len(runs))[::-1]
    unit, factor = _in_one_unit(runs)
    mean = factor * np.array([run.mean_error for run in runs])
    std = factor * np.array([run.std_error for run in runs])
    largest = factor * np.array([run.max_error for run in runs])
    axes.hlines(places, mean, largest, color="0.8", lw=0.8)
    axes.plot(mean, places, "o", color=NETWORK, label=r"$\bar e$")
    axes.plot(mean + std, places, "|", ms=9, color=NETWORK, label=r"$\bar e + \sigma(e)$")
    axes.plot(largest, places, "x", ms=5, color=REFERENCE, label="largest of a component")
    axes.set_xscale("log")
    number_plainly(axes.xaxis)
    axes.set_xlabel(f"error on the test split [{unit}]")
    axes.set_yticks(places, [run.run for run in runs])
    axes.set_ylim(-0.6, len(runs) - 0.4)
    figure.legend(loc="outside upper center", ncols=3, fontsize=9)
    return figure


def _in_one_unit(runs: Sequence[Compared]) -> tuple[str, NDArray[np.float64]]:
    """Unit of all errors, and the factor to it from the unit of each run, (n_runs,)."""
    units = [run.unit for run in runs]
    first = units[0]
    if unknown := [unit for unit in units if unit not in LENGTHS and set(units) != {first}]:
        raise InputError(
            f"the runs are in {' and '.join(sorted(set(units)))}: expected one unit of length for "
            f"a figure, as '{unknown[0]}' cannot be converted"
        )
    to_first = np.array([1.0 if u == first else LENGTHS[u] / LENGTHS[first] for u in units])
    errors = to_first * np.array([run.max_error for run in runs])
    unit, factor = Units(length=first).drawn(errors)
    return unit, factor * to_first
