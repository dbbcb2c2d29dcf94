"""Colours of curves that stand in one figure."""

from __future__ import annotations

from shared_schema.common.drawing.figure_style import NETWORK, REFERENCE

OTHER = "#2a7f3f"  # a second network
CURVES = (NETWORK, REFERENCE, OTHER, "#d98a00", "#7a3fa0")
