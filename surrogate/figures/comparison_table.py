"""Table and figure of several runs beside each other."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import asdict, fields
from io import StringIO

import numpy as np
from matplotlib.figure import Figure

from shared_schema.common.drawing.figure_style import NETWORK, REFERENCE, make_figure, styled
from shared_schema.common.text_table import laid_out
from surrogate.evaluation.run_comparison import Compared
from surrogate.figures.plain_log_axis import number_plainly

HEAD = ("run", "ē", "σ(e)", "largest", "tip", "parameters", "epochs", "training", "network")


def comparison_table(runs: Sequence[Compared]) -> str:
    """Lay out the errors of some runs, one line a run."""
    rows: list[tuple[str, ...]] = [HEAD]
    for run in runs:
        errors = (run.mean_error, run.std_error, run.max_error)
        rows.append(
            (
                run.run,
                *(f"{error:.2e} m" for error in errors),
                f"{run.relative_tip_error:.2%}",
                f"{run.parameters / 1e6:.2f} M",
                str(run.epochs),
                f"{run.minutes:.3g} min",
                run.network,
            )
        )
    return laid_out(rows)


def comparison_csv(runs: Sequence[Compared]) -> str:
    """Return the same as comma-separated values; errors in m."""
    text = StringIO()
    writer = csv.DictWriter(text, [field.name for field in fields(Compared)], lineterminator="\n")
    writer.writeheader()
    writer.writerows(asdict(run) for run in runs)
    return text.getvalue()


@styled
def comparison_figure(runs: Sequence[Compared]) -> Figure:
    """Draw mean error, mean and standard deviation, and largest error of every run."""
    figure = make_figure(5.6, 1.1 + 0.32 * len(runs))
    axes = figure.subplots()
    places = np.arange(len(runs))[::-1]
    mean, std, largest = (
        1e3 * np.array([getattr(run, name) for run in runs])
        for name in ("mean_error", "std_error", "max_error")
    )
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
