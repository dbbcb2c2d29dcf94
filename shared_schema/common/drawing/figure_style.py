"""The style that all figures share: serif type, thin axes, undeformed grey, finite elements red."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from io import BytesIO
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

import matplotlib
from matplotlib.figure import Figure

from shared_schema.common.files import complete_or_absent

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")

UNDEFORMED, NETWORK, REFERENCE = "0.65", "#1f4fbf", "#c8202f"
STYLE: Any = {
    "font.family": "serif",
    "font.serif": ["STIXGeneral", "DejaVu Serif"],
    "mathtext.fontset": "stix",
    "font.size": 10,
    "axes.linewidth": 0.6,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "legend.frameon": False,
    "lines.linewidth": 1.2,
}
DPI = 200


def styled(draw: Callable[Arguments, Result]) -> Callable[Arguments, Result]:
    """Make a function draw in the style of this module, independent of the user's settings."""

    @wraps(draw)
    def wrapper(*args: Arguments.args, **kwargs: Arguments.kwargs) -> Result:
        with matplotlib.rc_context(STYLE):
            return draw(*args, **kwargs)

    return wrapper


def make_figure(width: float, height: float) -> Figure:
    """Make an empty figure of `width` by `height` inches, whose parts do not overlap."""
    return Figure(figsize=(width, height), layout="constrained")


@styled
def save(figure: Figure, path: Path) -> None:
    """Write a figure in the format of the file's suffix; it appears complete or not at all."""
    with complete_or_absent(path) as partial:
        figure.savefig(partial, dpi=DPI, bbox_inches="tight")


@styled
def png(figure: Figure) -> bytes:
    """Draw a figure as the content of a PNG file."""
    content = BytesIO()
    figure.savefig(content, format="png", dpi=DPI, bbox_inches="tight")
    return content.getvalue()


def legend_below(figure: Figure, columns: int) -> None:
    """Put a legend of everything that has a label below the figure."""
    figure.legend(loc="upper center", bbox_to_anchor=(0.5, 0.0), ncols=columns)
