"""Figures of deformed meshes in the paper's style.

The undeformed mesh is grey, the network's is blue, that of the finite elements red.
"""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from shared_schema.common.drawing.drawing import Drawing
from shared_schema.common.drawing.figure_style import (
    NETWORK,
    REFERENCE,
    UNDEFORMED,
    legend_below,
    make_figure,
    styled,
)
from shared_schema.common.drawing.mesh_drawing import make_drawing
from surrogate.figures.field_figures import NODAL_ERROR, drawn
from surrogate.learning.measures.error_metrics import node_errors
from surrogate.mechanics.body.geometry import Geometry

Array = NDArray[np.float64]
PREDICTION = "prediction"  # in a legend


@styled
def deformed_meshes(
    geometry: Geometry, predicted: Array, reference: Array, force: Array, name: str = PREDICTION
) -> Figure:
    """Draw the undeformed mesh and both deformed meshes, predicted and reference, in one plot.

    Parameters
    ----------
    geometry : Geometry
    predicted, reference : array, (n_nodes, d)
        Displacements in m.
    force : array, (n_nodes, d)
        Nodal forces in N, drawn at the deformed nodes.
    name : str
        Name of the prediction in the legend.
    """
    figure = make_figure(6.4, 3.6)
    drawing = make_drawing(figure, geometry)
    _draw_meshes(drawing, geometry, predicted, reference, name)
    drawing.forces(geometry.coordinates + reference, force)
    drawing.finish()
    legend_below(figure, columns=3)
    return figure


@styled
def close_up(
    geometry: Geometry,
    predicted: Array,
    reference: Array,
    nodes: NDArray[np.int64],
    around: float,
    name: str = PREDICTION,
) -> Figure:
    """Draw both deformed meshes near some nodes, and mark these nodes.

    Parameters
    ----------
    geometry : Geometry
    predicted, reference : array, (n_nodes, d)
        Displacements in m.
    nodes : array of int
    around : float
        Height shown above and below these nodes, in m; twice as much is shown to their sides.
    name : str
        Name of the prediction in the legend.
    """
    figure = make_figure(6.4, 3.2)
    drawing = make_drawing(figure, geometry)
    drawing.markers((geometry.coordinates + reference)[nodes], "black", s=24)
    lower, upper = drawing.extent()
    _draw_deformed(drawing, geometry, predicted, reference, name, wide=1.8)
    room = np.array((2 * around, around))
    drawing.finish((lower - room, upper + room), labelled=False)
    legend_below(figure, columns=2)
    return figure


@styled
def meshes_and_errors(
    geometry: Geometry, predicted: Array, reference: Array, force: Array, name: str = PREDICTION
) -> Figure:
    """Draw `deformed_meshes` and `error_field` side by side."""
    figure = make_figure(9.6, 3.2)
    left, right = make_drawing(figure, geometry, 121), make_drawing(figure, geometry, 122)
    _draw_meshes(left, geometry, predicted, reference, name)
    left.forces(geometry.coordinates + reference, force)
    left.finish()
    errors, label = drawn(geometry.units, node_errors(predicted, reference), NODAL_ERROR)
    right.coloured(geometry.coordinates + predicted, errors, label)
    right.finish(left.extent() if geometry.dimension == 2 else None)
    legend_below(figure, columns=3)
    return figure


def _draw_meshes(
    drawing: Drawing, geometry: Geometry, predicted: Array, reference: Array, name: str
) -> None:
    """Draw all three meshes, with finer lines in 3D, where there are more of them."""
    drawing.undeformed(UNDEFORMED, "undeformed", linewidth=0.6)
    wide = 1.8 if geometry.dimension == 2 else 0.9
    _draw_deformed(drawing, geometry, predicted, reference, name, wide)


def _draw_deformed(
    drawing: Drawing,
    geometry: Geometry,
    predicted: Array,
    reference: Array,
    name: str,
    wide: float,
) -> None:
    x = geometry.coordinates
    drawing.mesh(x + reference, REFERENCE, "finite elements", linewidth=wide)
    drawing.mesh(x + predicted, NETWORK, name, linewidth=0.45 * wide)
