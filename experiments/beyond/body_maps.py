"""Maps of nodal values on a body, a panel a network."""

from __future__ import annotations

import numpy as np
from matplotlib import colormaps
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.gridspec import GridSpec
from numpy.typing import NDArray

from experiments.beyond.error_curves import WIDTH
from shared_schema.common.drawing import UNDEFORMED, make_drawing, make_figure, styled
from surrogate.learning.data import Geometry


@styled
def draw_maps(
    geometry: Geometry, maps: dict[str, NDArray[np.float64]], norm: Normalize, label: str
) -> Figure:
    """Draw values at the nodes, (n_nodes,) each; nodes with NaN are left out."""
    x, size = geometry.coordinates, np.ptp(geometry.coordinates, axis=0)
    height = 0.6 + WIDTH * float(size[1] / size[0]) if geometry.dimension == 2 else 1.9
    figure = make_figure(WIDTH, height * len(maps))
    colours, places = colormaps["viridis"], GridSpec(len(maps), 1, figure=figure)
    for place, (title, values) in enumerate(maps.items()):
        drawing = make_drawing(figure, geometry, places[place, 0])
        drawing.body(x, UNDEFORMED, "white", linewidth=0.4)
        nodes = drawing.seen_nodes(x)
        nodes = nodes[np.isfinite(values[nodes])]
        marks = 36 if geometry.dimension == 2 else 9
        drawing.markers(x[nodes], colours(norm(values[nodes])), s=marks)
        drawing.finish(labelled=False)
        drawing.axes.set_title(title, fontsize=10)
        drawing.axes.set_axis_off()
    bar = figure.colorbar(
        ScalarMappable(norm, colours), ax=figure.axes, location="bottom", shrink=0.8, aspect=30
    )
    bar.set_label(label)
    bar.outline.set_visible(False)
    return figure
