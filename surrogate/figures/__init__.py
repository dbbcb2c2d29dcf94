"""Figures of fields, errors, stresses and curves; nothing is measured or written here."""

from surrogate.figures.curves import CURVES, OTHER, loss_curves, sweep_curves
from surrogate.figures.field_figures import error_beside_certificate, error_beside_uncertainty
from surrogate.figures.mesh_figures import close_up, deformed_meshes, meshes_and_errors

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
