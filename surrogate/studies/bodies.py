"""The bodies of the datasets, drawn with their supports and loads."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from matplotlib.gridspec import GridSpec

from shared_schema.drawing.figure_style import REFERENCE, UNDEFORMED, make_figure, styled
from shared_schema.drawing.mesh_drawing import make_drawing
from surrogate.data.geometry import Geometry


@styled
def draw_bodies(geometries: dict[str, Geometry]) -> Figure:
    """Meshes side by side with their names, clamped nodes black, loadable ones red."""
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
