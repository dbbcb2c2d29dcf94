"""Figure of one deformed body: a field in colour, its forces, the undeformed outline."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from shared_schema.common.drawing.drawn_mesh import Mesh
from shared_schema.common.drawing.figure_style import UNDEFORMED, make_figure, styled
from shared_schema.common.drawing.mesh_drawing import make_drawing

Array = NDArray[np.float64]


@styled
def deformed_figure(
    mesh: Mesh,
    displacement: Array,
    force: Array,
    values: Array | None = None,
    label: str = r"displacement $\|u\|_2$",
) -> Figure:
    """Draw a body in its deformed state, coloured by the lengths of vectors at its nodes.

    Parameters
    ----------
    mesh : Mesh
    displacement : array, (n_nodes, d)
        In m.
    force : array, (n_nodes, d)
        In N; the longest arrow has a fixed length.
    values : array, (n_nodes, d), optional
        The vectors in m, by default the displacement.
    label : str
        Name of the vectors.
    """
    figure = make_figure(6.4, 3.6)
    drawing = make_drawing(figure, mesh)
    x = mesh.coordinates + displacement
    drawing.undeformed(UNDEFORMED, None, linewidth=0.6)
    length = np.linalg.norm(displacement if values is None else values, axis=1)
    unit, factor = drawing.units.drawn(length)
    drawing.coloured(x, factor * length, f"{label} [{unit}]")
    drawing.forces(x, force)
    drawing.finish()
    return figure
