"""Logarithmic axes with plain numbers at 1, 2 and 5 of every decade."""

from __future__ import annotations

from matplotlib.axis import Axis
from matplotlib.ticker import LogLocator, NullFormatter


def number_plainly(axis: Axis) -> None:
    """Write 0.1, 0.2, 0.5, 1, … at a logarithmic axis, and nothing between them."""
    axis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    axis.set_major_formatter("{x:g}")
    axis.set_minor_formatter(NullFormatter())
