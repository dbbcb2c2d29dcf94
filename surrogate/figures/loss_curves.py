"""Figure of the loss over the epochs of a training."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from matplotlib.figure import Figure

from shared_schema.common.drawing.figure_style import NETWORK, REFERENCE, make_figure, styled

LOSSES = {"train_loss": ("training", NETWORK), "validation_loss": ("validation", REFERENCE)}


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
