"""The nodes of a plane mesh on the network's grid, which has points without nodes."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.gridspec import GridSpec
from numpy.typing import ArrayLike

from shared_schema.drawing.figure_style import REFERENCE, UNDEFORMED, make_figure, styled
from shared_schema.drawing.mesh_drawing import make_drawing
from surrogate.data.geometry import Geometry


@styled
def draw_padding(geometry: Geometry) -> Figure:
    """Left the numbered nodes of a plane mesh, right the same on its grid; circles stay zero."""
    figure = make_figure(9.6, 3.0)
    places = GridSpec(1, 2, figure=figure, width_ratios=(2, 3))
    drawing = make_drawing(figure, geometry, places[0, 0])
    drawing.body(geometry.coordinates, UNDEFORMED, "white", linewidth=0.4)
    drawing.finish()
    axes = figure.add_subplot(places[0, 1], aspect="equal")
    grid = geometry.grid
    nx, ny = grid.shape
    axes.hlines(range(ny), 0, nx - 1, color=UNDEFORMED, linewidth=0.4, zorder=0)
    axes.vlines(range(nx), 0, ny - 1, color=UNDEFORMED, linewidth=0.4, zorder=0)
    i, j = np.nonzero(~grid.mask)
    axes.scatter(i, j, s=22, facecolor="white", edgecolor=REFERENCE, linewidth=0.8)
    for i, j in np.argwhere(grid.mask):
        number = int(grid.node_at[i, j])
        _number(axes, (i, j), number)
        _number(drawing.axes, geometry.coordinates[number], number)
    axes.set_axis_off()
    return figure


def _number(axes: Axes, place: ArrayLike, number: int) -> None:
    """Write a number over the lines at a place (x, y)."""
    x, y = np.asarray(place, dtype=float)
    background = {"facecolor": "white", "edgecolor": "none", "pad": 0.6}
    axes.text(x, y, str(number), ha="center", va="center", fontsize=6, bbox=background)
