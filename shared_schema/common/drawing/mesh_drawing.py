"""The drawing that fits a mesh, in the plane or in space."""

from __future__ import annotations

from typing import Any

from matplotlib.figure import Figure

from shared_schema.common.drawing.drawing import Drawing
from shared_schema.common.drawing.drawn_mesh import Mesh
from shared_schema.common.drawing.plane_drawing import PlaneDrawing
from shared_schema.common.drawing.space_drawing import SpaceDrawing


def make_drawing(figure: Figure, mesh: Mesh, position: Any = 111) -> Drawing:
    """Make the drawing that fits the body's dimension, at a position of the figure's grid."""
    kind = PlaneDrawing if mesh.coordinates.shape[1] == 2 else SpaceDrawing
    return kind(figure.add_subplot(position), mesh)
