"""Figure of one deformed body: its displacement in colour, its forces, the undeformed outline."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from shared_schema.common.drawing.drawn_mesh import Mesh
from shared_schema.common.drawing.figure_style import UNDEFORMED, make_figure, styled
from shared_schema.common.drawing.mesh_drawing import make_drawing

Array = NDArray[np.float64]
SIZE = 5.5, 4.0  # inches


@styled
def deformed_figure(mesh: Mesh, displacement: Array, force: Array, title: str = "") -> Figure:
    """Draw a body in its deformed state.

    Parameters
    ----------
    mesh : Mesh
    displacement : array, (n_nodes, d)
        In m.
    force : array, (n_nodes, d)
        In N; the longest arrow has a fixed length.
    title : str
        Of the figure.
    """
    figure = make_figure(*SIZE)
    drawing = make_drawing(figure, mesh)
    x = mesh.coordinates + displacement
    field = drawing.field(x, np.linalg.norm(displacement, axis=1))
    drawing.undeformed(UNDEFORMED, None, linewidth=0.5)
    drawing.forces(x, force)
    drawing.finish()
    drawing.axes.set_title(title, fontsize=10)
    label = f"displacement [{drawing.units.length}]"
    figure.colorbar(field, ax=drawing.axes, label=label, shrink=0.8)
    return figure
