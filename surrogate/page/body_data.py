"""The mechanics of a body as data: recordings of its materials, elements, supports, surfaces.

The page's script (``web/src/mechanics``) computes with these what `surrogate.mechanics` and
`surrogate.mechanics.series` compute, for any material, element and load: it knows no material by
name.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from shared_schema.common.bodies.distributed_loads import normals_of, shape_functions
from shared_schema.common.bodies.reference_cells import (
    LINEAR,
    quadratic_quadrature,
    quadratic_shape_gradients,
    quadrature,
    shape_gradients,
)
from surrogate.mechanics.energy.law import Law
from surrogate.mechanics.energy.recording import Recording
from surrogate.mechanics.equilibrium.out_of_balance import Equilibrium
from surrogate.mechanics.matrices.orders import band_order
from surrogate.mechanics.solids.recorded_law import recorded_law
from surrogate.mechanics.solids.taylor_hood import TaylorHoodSolid

Arrays = dict[str, NDArray[Any]]


def body_data(equilibrium: Equilibrium) -> tuple[dict[str, Any], Arrays]:
    """Describe the body of an equilibrium.

    Returns
    -------
    text : dict
        Laws of the materials and functions of the reference cell, as plain data.
    arrays : dict
        Points and cells, which are sorted by material; numbers of the free unknowns in the order
        of the page's factors; points between the nodes. Names of parts of a part are paths.
    """
    solid, geometry = equilibrium.solid, equilibrium.geometry
    parts = solid.material_of_cells().numpy()
    order = np.argsort(parts, kind="stable")
    cells, cell_type = geometry.cells[order], geometry.cell_type
    at, _ = _quadrature(cell_type)
    slopes = quadratic_shape_gradients if cell_type in LINEAR else shape_gradients
    rounding = equilibrium.round_off
    text: dict[str, Any] = {
        "d": geometry.dimension,
        "nodes": equilibrium.nodes,
        "laws": [law_data(law, geometry.dimension, solid.projects) for law in solid.laws],
        "gradients": _rows(slopes(cell_type, at)),
        "rounding": {
            "energy": equilibrium.rounding,
            "atRest": rounding.at_rest,
            "perDisplacement": rounding.per_displacement,
        },
    }
    arrays: Arrays = {
        "coordinates": geometry.coordinates.astype(np.float64),
        "cells": cells.astype(np.int32),
        "parts": parts[order].astype(np.int32),
        "volumes": solid.volumes.numpy()[order],
        "order": free_unknowns(equilibrium).astype(np.int32),
    }
    if solid.projects:
        text["dilation"] = {
            "shapes": solid.shapes.tolist(),
            "joined": isinstance(solid, TaylorHoodSolid),
        }
        arrays["dilation/nodes"] = solid.corners.numpy()[order].astype(np.int32)
    if solid.fibres is not None:
        arrays["fibres"] = solid.fibres[..., 0, 0].permute(2, 0, 1).numpy()[order]
    if equilibrium.points is not None:
        between = equilibrium.points.interpolation[equilibrium.nodes :].tocsr()
        arrays |= {f"between/{name}": array for name, array in sparse_rows(between).items()}
    return text, arrays


def surface_data(surfaces: Sequence[NDArray[np.int64]], d: int) -> tuple[dict[str, Any], Arrays]:
    """Describe the facets that pressures follow, of every surface, in d dimensions.

    Returns
    -------
    text : dict
        ``surfaces``, with the forces of a unit pressure on a facet; empty if no pressure acts.
    arrays : dict
    """
    if not surfaces:
        return {}, {}
    facets = np.concatenate(surfaces)
    numbers = np.repeat(np.arange(len(surfaces)), [len(each) for each in surfaces])
    arrays = {"facets": facets.astype(np.int32), "surfaces": numbers.astype(np.int32)}
    text = {"surfaces": {"facet": facet_data(facets.shape[1], d)}}
    return text, {f"surfaces/{name}": array for name, array in arrays.items()}


def facet_data(points: int, d: int) -> dict[str, Any]:
    """Forces of a unit pressure on a facet, as a recording of the positions of its points."""
    values, gradients, weights = shape_functions(points, d)
    recording = Recording(points * d)
    position = recording.inputs.reshape(points, d)
    tangents = np.tensordot(gradients.swapaxes(1, 2).astype(object), position, 1)
    weighted = (weights[:, None] * values).T.astype(object)
    forces = weighted @ normals_of(tangents[None])[0]
    return recording.data([0] * (points * d), {"outputs": -forces.ravel()})


def law_data(law: Law, d: int, projects: bool) -> dict[str, Any]:
    """A law of a material as a recording of F, directions of fibres and, of some elements, θ and p.

    Its outputs are the derivatives of W(F, θ) + p (J - θ), by F and, where there are some, θ and
    p. These, J and ∂W/∂θ follow in stages, as θ and p are known.
    """
    recording, outputs = recorded_law(law, d, projects)
    beside = [1, 2] if projects else []
    names = {"outputs": "derivatives", "volume": "volume", "energy": "energy"}
    names |= {"slope": "slope"} if projects else {}
    outputs = {name: outputs[of] for name, of in names.items()}
    return recording.data([0] * (recording.count - len(beside)) + beside, outputs)


def sparse_rows(matrix: csr_array) -> Arrays:
    """Rows of a sparse matrix as arrays."""
    starts, nodes = matrix.indptr.astype(np.int32), matrix.indices.astype(np.int32)
    return {"starts": starts, "nodes": nodes, "weights": matrix.data}


def free_unknowns(equilibrium: Equilibrium) -> NDArray[np.int64]:
    """Numbers of the free unknowns in an order of narrow bands.

    Displacements are point · d + component; dilations and pressures of Taylor and Hood's elements
    follow after all of these, and stand after the displacements of their node in the order
    (`surrogate.mechanics.matrices.saddle_point`).
    """
    solid, geometry = equilibrium.solid, equilibrium.geometry
    held = ~equilibrium.free
    if not isinstance(solid, TaylorHoodSolid):
        return band_order(geometry.coordinates, geometry.cells, held)[0]
    points, d = held.shape
    nodes = int(solid.corners.max()) + 1
    beside = np.repeat(np.arange(points)[:, None] >= nodes, 2, axis=1)
    width = d + 2
    dofs, _ = band_order(geometry.coordinates, geometry.cells, np.hstack([held, beside]))
    point, component = np.divmod(dofs, width)
    numbers = np.where(component < d, point * d + component, points * d + point)
    return np.asarray(numbers + np.where(component == d + 1, nodes, 0))


def band_entries(equilibrium: Equilibrium, order: NDArray[np.int64]) -> int:
    """Entries of the band of K in an order, at most."""
    size = equilibrium.free.size
    place = np.full(size, -1)
    shown = order < size
    place[order[shown]] = np.flatnonzero(shown)
    d = equilibrium.geometry.dimension
    cells = equilibrium.geometry.cells[:, :, None] * d + np.arange(d)
    rows = place[cells.reshape(len(cells), -1)]
    first = np.where(rows < 0, len(order), rows).min(axis=1)
    width = int((rows.max(axis=1) - first).max(initial=0))
    return len(order) * (width + 1)


def _quadrature(cell_type: str) -> tuple[NDArray[np.float64], Any]:
    return (quadratic_quadrature if cell_type in LINEAR else quadrature)(cell_type)


def _rows(gradients: NDArray[np.float64]) -> list[list[float]]:
    """Gradients (n_points, n_corners, k) as a list for every point."""
    return gradients.reshape(len(gradients), -1).tolist()
