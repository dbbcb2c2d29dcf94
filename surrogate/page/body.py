"""The body of a page: what is drawn, and what its mechanics are computed from."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from shared_schema.common.errors import InputError
from shared_schema.materials import NeoHookean
from surrogate.data.elements_of_case import body_of_response, require_linear_elements
from surrogate.data.geometry import Geometry
from surrogate.inference.surrogate import Surrogate
from surrogate.mechanics.matrices.band_matrix import BandLayout
from surrogate.page.surface import surface_of

BAND = 2**24  # entries of a band that a page factorises: 134 MB
Arrays = dict[str, NDArray[Any]]


@dataclass(frozen=True)
class Mechanics:
    """What a page computes linear responses and estimated errors from.

    Attributes
    ----------
    material : dict or None
        Lamé parameters in Pa, name of the volumetric term, and whether the volumes of cells change
        as a whole; None if the page has no mechanics.
    arrays : dict
        Order of the degrees of freedom in the band of K; on embedded grids also the nodes, with
        weights, that a nodal force reaches by way of the grid.
    certified : bool
        Whether the page estimates errors: they are those of linear elements under dead loads.
    band : int
        Entries of the band of K, if the network needs it and it is too large for a page; else 0.
    """

    material: dict[str, Any] | None
    arrays: Arrays
    certified: bool
    band: int = 0


def drawn(geometry: Geometry) -> Arrays:
    """Mesh, supports and surface."""
    surface = surface_of(geometry)
    return {
        "coordinates": geometry.coordinates.astype(np.float64),
        "cells": geometry.cells.astype(np.int32),
        "held": geometry.held.astype(np.uint8),
        "loadable": geometry.loadable.astype(np.uint8),
        "vertices": surface.vertices,
        "triangles": surface.triangles,
        "lines": surface.lines,
        "features": surface.features,
        "supports": surface.supports,
    }


def mechanics_of(surrogate: Surrogate) -> Mechanics:
    """Material and order of the band; nothing if the network does without and they are lacking.

    Raises
    ------
    InputError
        If the network contains the linear response, and the body is none that a page can compute.
    """
    data, series = surrogate.description.data, surrogate.description.run.has_series
    is_needed, certified = surrogate.network.linear is not None, _certified(surrogate)
    geometry = surrogate.geometry
    try:
        geometry, material = body_of_response(geometry, data.material, data.case, series)
        if not isinstance(material, NeoHookean):
            raise InputError("page: expected a Neo-Hookean body of one material")
        if not certified and not is_needed:
            return Mechanics(None, {}, False)
        layout = BandLayout(geometry.coordinates, geometry.cells, geometry.held)
        entries = len(layout.dofs) * (layout.width + 1)
        if entries > BAND:
            return Mechanics(None, {}, False, entries if is_needed else 0)
    except InputError:
        if is_needed:
            raise
        return Mechanics(None, {}, False)
    arrays: Arrays = {"order": layout.dofs.astype(np.int32)}
    if is_needed and not geometry.grid.points_are_nodes:
        spread = spread_of(geometry)
        arrays |= {
            "spreadStarts": spread.indptr.astype(np.int32),
            "spreadNodes": spread.indices.astype(np.int32),
            "spreadWeights": spread.data,
        }
    constants: dict[str, Any] = {"lambda": material.lame_lambda, "mu": material.lame_mu}
    constants |= {"volumetric": material.volumetric, "meanDilation": geometry.mean_dilation}
    return Mechanics(constants, arrays, certified)


def _certified(surrogate: Surrogate) -> bool:
    try:
        require_linear_elements(surrogate.description.data.case, "estimates on a page")
        surrogate.balanced()
    except InputError:
        return False
    return True


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
