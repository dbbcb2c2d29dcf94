"""Figures of fields, errors, stresses and curves; nothing is measured or written here."""

from surrogate.figures.curve_colours import CURVES, OTHER
from surrogate.figures.field_figures import error_beside_certificate, error_beside_uncertainty
from surrogate.figures.loss_curves import loss_curves
from surrogate.figures.mesh_figures import close_up, deformed_meshes, meshes_and_errors
from surrogate.figures.sweep_curves import sweep_curves

__all__ = [
    "CURVES",
    "OTHER",
    "close_up",
    "deformed_meshes",
    "error_beside_certificate",
    "error_beside_uncertainty",
    "loss_curves",
    "meshes_and_errors",
    "sweep_curves",
]
