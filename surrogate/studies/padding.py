"""The nodes of a plane mesh on the network's grid, which has points without nodes."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.gridspec import GridSpec

from shared_schema.figure_style import REFERENCE, UNDEFORMED, make_figure, styled
from shared_schema.grid_map import GridMap
from shared_schema.mesh_drawing import make_drawing
from surrogate.geometry import Geometry


@styled
def draw_padding(geometry: Geometry) -> Figure:
    """Left the numbered nodes of a plane mesh, right the same on its grid; circles stay zero."""
    assert isinstance(geometry.grid, GridMap)
    figure = make_figure(9.6, 3.0)
    places = GridSpec(1, 2, figure=figure, width_ratios=(2, 3))
    drawing = make_drawing(figure, geometry, places[0, 0])
    drawing.body(geometry.coordinates, UNDEFORMED, "white", linewidth=0.4)
    drawing.finish()
    axes = figure.add_subplot(places[0, 1], aspect="equal")
    grid, points = geometry.grid, np.indices(geometry.grid.shape).reshape(2, -1).T
    for row in range(grid.shape[1]):
        axes.plot((0, grid.shape[0] - 1), (row, row), color=UNDEFORMED, linewidth=0.4, zorder=0)
    for column in range(grid.shape[0]):
        axes.plot(2 * [column], (0, grid.shape[1] - 1), color=UNDEFORMED, linewidth=0.4, zorder=0)
    empty = points[~grid.mask.ravel()]
    axes.scatter(*empty.T, s=22, facecolor="white", edgecolor=REFERENCE, linewidth=0.8)
    style: dict[str, Any] = {"ha": "center", "va": "center", "fontsize": 6}
    background = {"facecolor": "white", "edgecolor": "none", "pad": 0.6}
    for point in points[grid.mask.ravel()]:
        number = grid.node_at[tuple(point)]
        axes.text(*point, str(number), bbox=background, **style)
        drawing.axes.text(*geometry.coordinates[number], str(number), bbox=background, **style)
    axes.set_axis_off()
    return figure
