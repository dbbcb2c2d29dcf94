"""The figure of a solution."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from shared_schema.common.drawing.figure_style import UNDEFORMED, make_figure, styled
from shared_schema.common.drawing.mesh_drawing import make_drawing
from surrogate.learning.inference.solution import Solution


@styled
def solution_figure(solution: Solution) -> Figure:
    """Draw the deformed body, coloured by error, standard deviation or displacement."""
    geometry = solution.geometry
    values, label = solution.displacement, r"displacement $\|u\|_2$"
    if solution.certificate is not None and np.isfinite(solution.certificate.error).all():
        values, label = solution.certificate.error, "estimated error of a node"
    elif solution.std is not None:
        values, label = solution.std, r"standard deviation $\|\sigma\|_2$"
    figure = make_figure(6.4, 3.6)
    drawing = make_drawing(figure, geometry)
    x = geometry.coordinates + solution.displacement
    drawing.undeformed(UNDEFORMED, None, linewidth=0.6)
    size = np.linalg.norm(values, axis=1)
    unit, factor = solution.units.drawn(size)
    drawing.coloured(x, factor * size, f"{label} [{unit}]")
    drawing.forces(x, solution.force)
    drawing.finish()
    return figure
