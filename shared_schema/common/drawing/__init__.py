"""Figures of both programs: one style, and meshes in two and three dimensions."""

from shared_schema.common.drawing.figure_style import (
    NETWORK,
    REFERENCE,
    UNDEFORMED,
    legend_below,
    make_figure,
    save,
    styled,
)
from shared_schema.common.drawing.mesh_drawing import make_drawing

__all__ = [
    "NETWORK",
    "REFERENCE",
    "UNDEFORMED",
    "legend_below",
    "make_drawing",
    "make_figure",
    "save",
    "styled",
]
