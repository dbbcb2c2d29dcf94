"""The mechanics of a body as data: tapes of its materials, elements, supports, surfaces.

The page's script (``web/src/mechanics``) computes with these what `surrogate.mechanics` and
`surrogate.series` compute, for any material, element and load: it knows no material by name.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shared_schema.common.bodies.facet_quadrature import shape_functions
from shared_schema.common.bodies.quadratic.quadratic_cells import (
    LINEAR,
    quadratic_quadrature,
    quadratic_shape_gradients,
)
from shared_schema.common.bodies.reference_cells import quadrature, shape_gradients
from surrogate.mechanics.energy.law import Law
from surrogate.mechanics.energy.tape import Tape
from surrogate.mechanics.matrices.band_matrix import BandLayout
from surrogate.mechanics.out_of_balance import Equilibrium
from surrogate.mechanics.quadratic import QuadraticEquilibrium
from surrogate.mechanics.solids.mean_dilation import MeanDilationSolid
from surrogate.mechanics.solids.taylor_hood import TaylorHoodSolid
from surrogate.series.measured_series import slopes_at_rest, used_measures

Arrays = dict[str, NDArray[Any]]


def body_data(equilibrium: Equilibrium) -> tuple[dict[str, Any], Arrays]:
    """Describe the body of an equilibrium.

    Returns
    -------
    text : dict
        Laws of the materials and functions of the reference cell, as plain data.
    arrays : dict
        Points and cells, which are sorted by material; numbers of the free unknowns in the order
        of the page's factors; facets under pressures; points between the nodes.
    """
    solid, geometry = equilibrium.solid, equilibrium.geometry
    parts = solid.material_of_cells().numpy()
    order = np.argsort(parts, kind="stable")
    cells, cell_type = geometry.cells[order], geometry.cell_type
    at, weights = _quadrature(cell_type)
    slopes = quadratic_shape_gradients if cell_type in LINEAR else shape_gradients
    text: dict[str, Any] = {
        "nodes": equilibrium.nodes,
        "laws": [
            law_data(law) | {"lambda": material.lame_lambda, "mu": material.lame_mu}
            for law, material in zip(solid.laws, solid.materials, strict=True)
        ],
        "reference": {
            "gradients": _rows(slopes(cell_type, at)),
            "weights": np.broadcast_to(weights, len(at)).tolist(),
        },
        "edge": equilibrium.cell_size,
        "dilation": None,
        "facet": None,
    }
    arrays: Arrays = {
        "points": geometry.coordinates.astype(np.float64),
        "elements": cells.astype(np.int32),
        "parts": parts[order].astype(np.int32),
        "order": free_unknowns(equilibrium).astype(np.int32),
    }
    if isinstance(solid, TaylorHoodSolid | MeanDilationSolid):
        joined = isinstance(solid, TaylorHoodSolid)
        shapes = (
            solid.shapes.numpy() if isinstance(solid, TaylorHoodSolid) else np.ones((len(at), 1))
        )
        text["dilation"] = {"shapes": shapes.tolist(), "joined": joined}
        numbers = cells[:, : shapes.shape[1]] if joined else np.arange(len(cells))
        arrays["dilations"] = numbers.astype(np.int32)
    if solid.fibres is not None:
        arrays["fibres"] = solid.fibres[..., 0, 0].permute(2, 0, 1).numpy()[order]
    if isinstance(equilibrium, QuadraticEquilibrium):
        between = equilibrium.points.interpolation[equilibrium.nodes :].tocsr()
        arrays |= {
            "betweenStarts": between.indptr.astype(np.int32),
            "betweenNodes": between.indices.astype(np.int32),
            "betweenWeights": between.data,
        }
    return text, arrays


def surface_data(
    surfaces: Sequence[NDArray[np.int64]], d: int
) -> tuple[dict[str, Any] | None, Arrays]:
    """Describe the facets that pressures follow, of every surface, in d dimensions.

    Returns
    -------
    text : dict or None
        Weighted shape functions of a facet and their gradients at its quadrature points; None if no
        pressure acts.
    arrays : dict
    """
    if not surfaces:
        return None, {}
    facets = np.concatenate(surfaces)
    values, gradients, weights = shape_functions(facets.shape[1], d)
    text = {"values": (weights[:, None] * values).tolist(), "gradients": _rows(gradients)}
    numbers = np.repeat(np.arange(len(surfaces)), [len(each) for each in surfaces])
    return text, {"facets": facets.astype(np.int32), "facetSurfaces": numbers.astype(np.int32)}


def law_data(law: Law) -> dict[str, Any]:
    """A law of a material as plain data."""
    return {
        "count": law.count,
        "stress": tape_data(law.stress),
        "energy": tape_data(law.energy),
        "rest": [float(value) for value in law.stress.slots(law.at_rest)],
        "slopes": slopes_at_rest(law),
        "used": sorted(used_measures(law)),
    }


def tape_data(tape: Tape) -> dict[str, Any]:
    """A tape as plain data."""
    names = ("codes", "left", "right", "constants", "outputs", "fixed")
    return {name: getattr(tape, name).tolist() for name in names}


def free_unknowns(equilibrium: Equilibrium) -> NDArray[np.int64]:
    """Numbers of the free unknowns in an order of narrow bands.

    Displacements are point · d + component; dilations and pressures of Taylor and Hood's elements
    follow after all of these, and stand after the displacements of their node in the order
    (`surrogate.mechanics.matrices.saddle_point`).
    """
    solid, geometry = equilibrium.solid, equilibrium.geometry
    held = ~equilibrium.free
    if not isinstance(solid, TaylorHoodSolid):
        return BandLayout(geometry.coordinates, geometry.cells, held).dofs
    points, d = held.shape
    nodes = int(solid.corners.max()) + 1
    beside = np.repeat(np.arange(points)[:, None] >= nodes, 2, axis=1)
    width = d + 2
    layout = BandLayout(geometry.coordinates, geometry.cells, np.hstack([held, beside]))
    point, component = np.divmod(layout.dofs, width)
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
