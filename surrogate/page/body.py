"""The body of a page: what is drawn, and what its mechanics are computed from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from shared_schema.common.errors import InputError
from surrogate.learning.data.case_loads import families_of
from surrogate.learning.inference.surrogate import Surrogate
from surrogate.learning.models.series_model import NoNetwork
from surrogate.mechanics.body.elements_of_case import body_of_response
from surrogate.mechanics.body.geometry import Geometry
from surrogate.mechanics.equilibrium.follower_pressure import FollowerPressure
from surrogate.mechanics.equilibrium.out_of_balance import Equilibrium
from surrogate.page.body_data import band_entries, body_data, sparse_rows, surface_data
from surrogate.page.surface import support_marks, surface_of

BAND = 2**24  # entries of a band that a page factorises: 134 MB
Arrays = dict[str, NDArray[Any]]


@dataclass(frozen=True)
class Mechanics:
    """What a page computes equilibria, load series, linear responses and estimated errors from.

    Attributes
    ----------
    body : dict or None
        The body of the finite elements (`surrogate.page.body_data`); None if the learner does not
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
    alone = isinstance(surrogate.network.network, NoNetwork)
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
        text, of_surfaces = surface_data(geometry.surfaces, geometry.dimension)
        entries = band_entries(equilibrium, arrays["order"])
        body, arrays = body | text, below("body", arrays | of_surfaces)
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
    units = np.eye(len(geometry.surfaces))
    points = geometry.pressed_points
    push = FollowerPressure.on(geometry.coordinates, geometry.surfaces, units, points)
    return np.asarray(push.load[:, : len(geometry.coordinates)] * geometry.free)


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
