"""Figures of nodal fields on deformed meshes: error and predicted standard deviation."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from shared_schema.common.drawing.figure_style import REFERENCE, legend_below, make_figure, styled
from shared_schema.common.drawing.mesh_drawing import make_drawing
from shared_schema.common.units import Units
from surrogate.learning.measures.error_metrics import node_errors
from surrogate.mechanics.body.geometry import Geometry

NODAL_ERROR = r"nodal error $\|U - u\|_2$"
NODAL_STD = r"nodal standard deviation $\|\sigma\|_2$"
Array = NDArray[np.float64]


def drawn(units: Units, lengths: Array, name: str) -> tuple[Array, str]:
    """Lengths in a unit that fits them, and their label with that unit."""
    unit, factor = units.drawn(lengths)
    return lengths * factor, f"{name} [{unit}]"


@styled
def nodal_field(geometry: Geometry, displacement: Array, values: Array, label: str) -> Figure:
    """Draw nodal values, interpolated over the elements, on a deformed mesh.

    Parameters
    ----------
    geometry : Geometry
    displacement : array, (n_nodes, d)
        Displacement of the mesh in m.
    values : array, (n_nodes,)
    label : str
        Name and unit of the values.
    """
    figure = make_figure(6.4, 3.6)
    drawing = make_drawing(figure, geometry)
    drawing.coloured(geometry.coordinates + displacement, values, label)
    drawing.finish()
    return figure


def error_field(geometry: Geometry, predicted: Array, reference: Array) -> Figure:
    """Draw the nodal error ‖U − u‖₂ on the predicted deformed mesh."""
    errors, label = drawn(geometry.units, node_errors(predicted, reference), NODAL_ERROR)
    return nodal_field(geometry, predicted, errors, label)


def uncertainty_field(geometry: Geometry, mean: Array, std: Array) -> Figure:
    """Draw the nodal ‖σ‖₂ on the mean deformed mesh.

    Parameters
    ----------
    geometry : Geometry
    mean, std : array, (n_nodes, d)
        μ and σ in m.
    """
    return nodal_field(
        geometry, mean, *drawn(geometry.units, np.linalg.norm(std, axis=1), NODAL_STD)
    )


@styled
def error_beside_uncertainty(
    geometry: Geometry, force: Array, mean: Array, std: Array, reference: Array
) -> Figure:
    """Draw the nodal error and the nodal ‖σ‖₂ side by side on the mean deformed mesh.

    The reference mesh and the forces are drawn over the error.

    Parameters
    ----------
    geometry : Geometry
    force : array, (n_nodes, d)
        Nodal forces in N.
    mean, std, reference : array, (n_nodes, d)
        μ, σ and u in m.
    """
    figure = make_figure(10.0, 3.2)
    x = geometry.coordinates
    left, right = make_drawing(figure, geometry, 121), make_drawing(figure, geometry, 122)
    units = geometry.units
    left.coloured(x + mean, *drawn(units, node_errors(mean, reference), NODAL_ERROR))
    left.mesh(x + reference, REFERENCE, "finite elements", linewidth=0.6)
    left.forces(x + mean, force)
    right.coloured(x + mean, *drawn(units, np.linalg.norm(std, axis=1), NODAL_STD))
    left.finish()
    right.finish(left.extent())
    legend_below(figure, columns=1)
    return figure


@styled
def error_beside_certificate(
    geometry: Geometry, predicted: Array, reference: Array, estimated: Array
) -> Figure:
    """Draw a prediction, its nodal error and the one that a certificate estimates, side by side.

    Parameters
    ----------
    geometry : Geometry
    predicted, reference, estimated : array, (n_nodes, d)
        U, u and the estimate of U − u in m.
    """
    figure, units = make_figure(12.0, 2.9), geometry.units
    error, estimate = node_errors(predicted, reference), np.linalg.norm(estimated, axis=1)
    unit, factor = units.drawn(error, estimate)
    fields = (
        drawn(units, np.linalg.norm(predicted, axis=1), "displacement"),
        (factor * error, f"{NODAL_ERROR} [{unit}]"),
        (factor * estimate, f"error by the certificate [{unit}]"),
    )
    for position, (values, name) in zip((131, 132, 133), fields, strict=True):
        drawing = make_drawing(figure, geometry, position)
        drawing.coloured(geometry.coordinates + predicted, values, name)
        drawing.finish()
    return figure
