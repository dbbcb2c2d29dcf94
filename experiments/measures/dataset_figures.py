"""Figures of the datasets: bodies with their supports and loads; nodes on the padded grid."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.gridspec import GridSpec
from numpy.typing import ArrayLike

from shared_schema.common.drawing import REFERENCE, UNDEFORMED, make_drawing, make_figure, styled
from surrogate.data import Geometry


@styled
def draw_bodies(geometries: dict[str, Geometry]) -> Figure:
    """Draw the meshes side by side: clamped nodes black, loadable nodes red."""
    figure = make_figure(9.0, 2.6)
    lengths = [np.ptp(geometry.coordinates[:, 0]) for geometry in geometries.values()]
    grid = GridSpec(1, len(geometries), figure=figure, width_ratios=lengths)
    for place, (name, geometry) in enumerate(geometries.items()):
        drawing = make_drawing(figure, geometry, grid[0, place])
        x, size = geometry.coordinates, 12 if geometry.dimension == 2 else 2
        drawing.body(x, UNDEFORMED, "white", linewidth=0.4)
        drawing.markers(x[geometry.clamped], "black", marker="s", s=size)
        drawing.markers(x[geometry.loadable], REFERENCE, marker="o", s=size)
        drawing.finish()
        drawing.axes.set_title(name, fontsize=10)
    return figure


@styled
def draw_padding(geometry: Geometry) -> Figure:
    """Draw the numbered nodes of a plane mesh, and on its grid; circles: points without a node."""
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
    """Write a number on a white background at a place (x, y)."""
    x, y = np.asarray(place, dtype=float)
    background = {"facecolor": "white", "edgecolor": "none", "pad": 0.6}
    axes.text(x, y, str(number), ha="center", va="center", fontsize=6, bbox=background)
