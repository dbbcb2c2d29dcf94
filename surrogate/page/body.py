"""The body of a page: what is drawn, and its mechanics as data.

The data are recordings of its materials, elements, supports and surfaces.
The page's script (``web/src/mechanics``) computes with these what `surrogate.mechanics` and
`surrogate.mechanics.series` compute, for any material, element and load: it knows no material by
name.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array, vstack

from shared_schema.common.bodies.cables import Cable
from shared_schema.common.bodies.distributed_loads import normals_of, shape_functions
from shared_schema.common.bodies.following_loads import FollowingLoad, PressedSurface
from shared_schema.common.bodies.reference_cells import (
    LINEAR,
    quadratic_quadrature,
    quadratic_shape_gradients,
    quadrature,
    shape_gradients,
)
from shared_schema.common.errors import InputError
from surrogate.learning.data.case_loads import families_of
from surrogate.learning.inference.surrogate import Surrogate
from surrogate.learning.models.series_model import NoNetwork
from surrogate.mechanics.body.elements_of_case import body_of_response
from surrogate.mechanics.body.geometry import Geometry
from surrogate.mechanics.energy.law import Law
from surrogate.mechanics.energy.recording import Recording
from surrogate.mechanics.equilibrium.following_loads import FollowingLoads
from surrogate.mechanics.equilibrium.out_of_balance import Equilibrium
from surrogate.mechanics.matrices.factors import band_order
from surrogate.mechanics.solids.deformation import recorded_law
from surrogate.mechanics.solids.mixed_elements import TaylorHoodSolid
from surrogate.mechanics.solids.solid import Solid
from surrogate.page.surface import support_marks, surface_of

Arrays = dict[str, NDArray[Any]]
BAND = 2**24  # entries of a band that a page factorises: 134 MB


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
    geometry, rounding = equilibrium.geometry, equilibrium.round_off
    of_cells = equilibrium.solid, geometry.coordinates, geometry.cell_type
    text, arrays = elements_data(*of_cells)
    text["nodes"] = equilibrium.nodes
    text["rounding"] = {
        "energy": equilibrium.rounding,
        "atRest": rounding.at_rest,
        "perDisplacement": rounding.per_displacement,
    }
    arrays["order"] = free_unknowns(equilibrium).astype(np.int32)
    if equilibrium.points is not None:
        between = equilibrium.points.interpolation[equilibrium.nodes :].tocsr()
        arrays |= below("between", sparse_rows(between))
    return text, arrays


def elements_data(
    solid: Solid, coordinates: NDArray[np.float64], cell_type: str
) -> tuple[dict[str, Any], Arrays]:
    """Describe elements, and points (n_points, d) in m, as `body_data` does."""
    d = coordinates.shape[1]
    parts = solid.material_of_cells().numpy()
    order = np.argsort(parts, kind="stable")
    at, _ = _quadrature(cell_type)
    slopes = quadratic_shape_gradients if cell_type in LINEAR else shape_gradients
    text: dict[str, Any] = {
        "d": d,
        "laws": [law_data(law, d, solid.projects) for law in solid.laws],
        "gradients": _rows(slopes(cell_type, at)),
    }
    arrays: Arrays = {
        "coordinates": coordinates.astype(np.float64),
        "cells": solid.cells.numpy()[order].astype(np.int32),
        "parts": parts[order].astype(np.int32),
        "volumes": solid.volumes.numpy()[order],
    }
    if solid.projects:
        text["dilation"] = {
            "shapes": solid.shapes.tolist(),
            "joined": isinstance(solid, TaylorHoodSolid),
        }
        arrays["dilation/nodes"] = solid.corners.numpy()[order].astype(np.int32)
    if solid.fibres is not None:
        arrays["fibres"] = solid.fibres[..., 0, 0].permute(2, 0, 1).numpy()[order]
    return text, arrays


def following_data(units: Sequence[FollowingLoad], d: int) -> tuple[dict[str, Any], Arrays]:
    """Describe the loads that follow the body, by their numbers, in d dimensions.

    Returns
    -------
    text : dict
        ``surfaces``, with the forces of a unit pressure on a facet, if there are some.
    arrays : dict
        Facets of surfaces; places of cables, as sums of points of the body and fixed ones.
    """
    text, arrays = dict[str, Any](), Arrays()
    pressed = {i: u.facets for i, u in enumerate(units) if isinstance(u, PressedSurface)}
    if pressed:
        facets = np.concatenate(list(pressed.values()))
        numbers = np.repeat(list(pressed), [len(each) for each in pressed.values()])
        text["surfaces"] = {"facet": facet_data(facets.shape[1], d)}
        arrays |= {"surfaces/facets": facets.astype(np.int32)}
        arrays |= {"surfaces/units": numbers.astype(np.int32)}
    cables = {i: u for i, u in enumerate(units) if isinstance(u, Cable)}
    if cables:
        places = vstack([cable.weights for cable in cables.values()]).tocsr()
        numbers = np.repeat(list(cables), [len(each.fixed) for each in cables.values()])
        arrays |= below("cables/places", sparse_rows(places))
        arrays |= {"cables/fixed": np.concatenate([cable.fixed for cable in cables.values()])}
        arrays |= {"cables/units": numbers.astype(np.int32)}
    return text, arrays


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


@dataclass(frozen=True)
class Mechanics:
    """What a page computes equilibria, load series, linear responses and estimated errors from.

    Attributes
    ----------
    body : dict or None
        The body of the finite elements (`surrogate.page.body`); None if the learner does not
        know its elements or material, or it is too large. Without it no errors are estimated.
    response : dict or None
        The body of the linear response in the network's input, where that is another one.
    pressed : tuple of str
        Names of the surfaces that pressures follow, as ``--load`` has them.
    pressures : tuple of float
        Largest pressure of the case on each of them in Pa.
    arrays : dict
        Of both bodies; on embedded grids also the nodes, with weights, whose forces reach each
        node by way of the grid; forces of unit pressures on the undeformed body.
    band : int
        Entries of the band of K, if the page cannot do without and it is too large; else 0.
    """

    body: dict[str, Any] | None
    response: dict[str, Any] | None
    pressed: tuple[str, ...]
    pressures: tuple[float, ...]
    arrays: Arrays
    band: int = 0


def coarser(excess: float, dimension: int) -> float:
    """How many times as large cells are of which a band has that many times fewer entries.

    The unknowns are as many as the inverse volume of the cells, the width of the band as its
    inverse area (in the plane length), so that its entries are as that power of their size.
    """
    return float(excess ** (1 / (2 * dimension - 1)))


def drawn(geometry: Geometry) -> Arrays:
    """Mesh, surface and marks of the supports."""
    surface = surface_of(geometry)
    arrays: Arrays = {
        "coordinates": geometry.coordinates.astype(np.float64),
        "cells": geometry.cells.astype(np.int32),
        "held": geometry.held.astype(np.uint8),
        "clamped": np.asarray(geometry.held.all(axis=1), np.uint8),
        "loadable": geometry.loadable.astype(np.uint8),
        "vertices": surface.vertices,
        "triangles": surface.triangles,
        "lines": surface.lines,
        "features": surface.features,
        "seams": surface.seams,
    }
    return arrays | below("marks", support_marks(geometry, surface.supports))


def mechanics_of(surrogate: Surrogate) -> Mechanics:
    """Describe the body, and that of the network's linear response.

    Raises
    ------
    InputError
        If the network contains the linear response, or the page has no network, and the body is
        none that the learner knows.
    """
    geometry = replace(surrogate.geometry, pressed_by_corners=False)  # as new loads press
    responds = surrogate.network.linear is not None
    alone = is_alone(surrogate)
    body: dict[str, Any] | None = None
    response: dict[str, Any] | None = None
    arrays: Arrays = {}
    band = 0
    try:
        equilibrium = surrogate.body.equilibrium
    except InputError:
        if alone:
            raise
    else:
        body, arrays = body_data(equilibrium)
        text, following = following_data(geometry.following, geometry.dimension)
        entries = band_entries(equilibrium, arrays["order"])
        body, arrays = body | text, below("body", arrays | following)
        if entries > BAND:
            body, arrays, band = None, {}, entries if alone else 0
    if responds and not alone and not band:
        own = equilibrium_of_response(surrogate)
        if body is None or own is not surrogate.body.equilibrium:
            response, of_response = body_data(own)
            entries = band_entries(own, of_response["order"])
            band = entries if entries > BAND else 0
            arrays |= below("response", of_response)
        if not geometry.grid.points_are_nodes:
            arrays |= below("spread", sparse_rows(spread_of(geometry).T.tocsr()))
    if band:
        return Mechanics(None, None, (), (), {}, band)
    pressed, largest = pressures_of(surrogate)
    if pressed:
        arrays["pushes"] = unit_pressures(geometry)
    return Mechanics(body, response, pressed, largest, arrays)


def is_alone(surrogate: Surrogate) -> bool:
    """True if a page predicts without a network: by a load series, or in modes of actuators."""
    is_series = isinstance(surrogate.network.network, NoNetwork)
    return is_series or surrogate.geometry.actuators is not None


def below(part: str, arrays: Mapping[str, NDArray[Any]]) -> Arrays:
    """Arrays of a part of the page, by their paths."""
    return {f"{part}/{name}": array for name, array in arrays.items()}


def equilibrium_of_response(surrogate: Surrogate) -> Equilibrium:
    """The body of a network's linear response; that of the finite elements itself if equal."""
    data, run = surrogate.description.data, surrogate.description.run
    if run.has_own_series and not surrogate.description.has_series_of_before:
        return surrogate.body.equilibrium
    series = run.has_series
    geometry, material = body_of_response(surrogate.geometry, data.material, data.case, series)
    if geometry is surrogate.geometry and material is data.material:
        return surrogate.body.equilibrium
    return Equilibrium(geometry, material)


def pressures_of(surrogate: Surrogate) -> tuple[tuple[str, ...], tuple[float, ...]]:
    """Names of the surfaces under pressures (`Geometry.surfaces`), and the largest pressures."""
    families = families_of(surrogate.description.data.case)
    pressed = [family for family in families if family["family"] == "pressure"]
    if len(pressed) != len(surrogate.geometry.surfaces):
        return (), ()
    names = tuple(str((family.get("region") or {}).get("group") or "") for family in pressed)
    return names, tuple(max(abs(float(end)) for end in family["range"]) for family in pressed)


def unit_pressures(geometry: Geometry) -> NDArray[np.float64]:
    """Forces of 1 Pa on each surface of the undeformed body, at the nodes: (n_surfaces, n, d)."""
    count, nodes = len(geometry.surfaces), len(geometry.coordinates)
    push = FollowingLoads.of(geometry, np.eye(count, len(geometry.following)))
    return np.asarray(push.load[:, :nodes] * geometry.free)


def spread_of(geometry: Geometry) -> csr_array:
    """Nodes that a force at each node reaches by way of an embedded grid, (n_nodes, n_nodes).

    Row j holds the weights of :math:`A^T B^T e_j` (`shared_schema.grid`).
    """
    grid, nodes = geometry.grid, len(geometry.coordinates)
    sources = np.maximum(grid.sources, 0).reshape(-1, grid.sources.shape[-1])
    to_grid = rows_of(sources, grid.source_weights.reshape(sources.shape), nodes)
    to_nodes = rows_of(grid.points, grid.point_weights, len(sources))
    spread = (to_nodes @ to_grid).tocsr()
    spread.eliminate_zeros()
    return spread


def rows_of(sources: NDArray[np.int64], weights: NDArray[np.float64], columns: int) -> csr_array:
    """Sparse matrix whose rows have some weights at some columns, both (n_rows, k)."""
    starts = np.arange(0, sources.size + 1, sources.shape[1])
    shape = (len(sources), columns)
    return csr_array((weights.ravel(), sources.ravel(), starts), shape=shape)
