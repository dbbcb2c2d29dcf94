"""Figures of stresses on deformed meshes."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from shared_schema.common.drawing.figure_style import make_figure, styled
from shared_schema.common.drawing.mesh_drawing import make_drawing
from surrogate.mechanics.body.geometry import Geometry

Array = NDArray[np.float64]


@styled
def von_mises_beside_reference(
    geometry: Geometry, predicted: Array, reference: Array, stresses: tuple[Array, Array]
) -> Figure:
    """Draw predicted and reference von Mises stresses side by side, in one range of colours.

    Values at the nodes are the means of those of the cells around.

    Parameters
    ----------
    geometry : Geometry
    predicted, reference : array, (n_nodes, d)
        Displacements in m.
    stresses : tuple of 2 arrays, (n_cells,)
        Von Mises stresses of both in Pa.
    """
    figure = make_figure(10.0, 3.2)
    left, right = make_drawing(figure, geometry, 121), make_drawing(figure, geometry, 122)
    x, nodal = geometry.coordinates, [at_nodes(geometry, values) for values in stresses]
    limits = 0.0, float(max(values.max() for values in nodal)) or 1.0
    names = "predicted", "finite elements"
    for drawing, u, values, name in zip(
        (left, right), (predicted, reference), nodal, names, strict=True
    ):
        drawing.coloured(
            x + u, values, f"von Mises stress, {name} [{geometry.units.stress}]", limits
        )
    left.finish()
    right.finish(left.extent() if geometry.dimension == 2 else None)
    return figure


def at_nodes(geometry: Geometry, values: Array) -> Array:
    """Mean at every node over its cells: (n_cells,) → (n_nodes,); inverted cells count as 0."""
    corners = geometry.cells.shape[1]
    sound = np.repeat(np.nan_to_num(values, posinf=0.0, neginf=0.0), corners)
    nodes, count = geometry.cells.ravel(), len(geometry.coordinates)
    total = np.bincount(nodes, weights=sound, minlength=count)
    return np.asarray(total / np.maximum(np.bincount(nodes, minlength=count), 1))
