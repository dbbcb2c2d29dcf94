from __future__ import annotations

from pathlib import Path

from surrogate.figures.curves import loss_curves
from tests.surrogate.figures.pictures import assert_is_picture

LINES = [
    {"epoch": 1, "train_loss": 1.0, "validation_loss": 1.1},
    {"epoch": 2, "train_loss": 0.1, "validation_loss": 0.2},
]


def test_loss_curves(tmp_path: Path) -> None:
    figure = loss_curves({"mean absolute error": LINES})
    assert_is_picture(figure, tmp_path)
    (axes,) = figure.axes
    assert (axes.get_title(), axes.get_ylabel()) == ("mean absolute error", "loss, scaled")


def test_losses_share_the_ordinate() -> None:
    """One of the two runs has no validation split; the smallest loss is 0.1, or below 0."""
    lines = [{"epoch": 1, "train_loss": 1.0}, {"epoch": 2, "train_loss": 0.5}]
    left, right = loss_curves({"a": lines, "b": LINES}).axes
    assert (len(left.lines), len(right.lines)) == (1, 2)
    assert left.get_ylim() == right.get_ylim()
    assert (left.get_yscale(), right.get_yscale()) == ("log", "log")
    negative = [*lines, {"epoch": 3, "train_loss": -0.5}]
    left, right = loss_curves({"a": negative, "b": LINES}).axes
    assert (left.get_yscale(), right.get_yscale()) == ("linear", "linear")
