"""Symbols of loads: an arrow at a node under a concentrated force, one symbol for a patch.

Loaded nodes that share cells form a patch. A patch of more than `FEW` nodes is a distributed load:
it has one symbol with the resultant. If it holds nodes inside the body, it is a body force;
otherwise it is a traction or a pressure on the faces between its nodes. A node of a patch whose
force is more than `CONCENTRATED` times that of nine tenths of its patch has its own arrow.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shared_schema.common.bodies.cells import boundary_facets, components
from shared_schema.common.drawing.drawn_mesh import Mesh

Array = NDArray[np.float64]
FEW = 12  # nodes of a patch that have an arrow each
CONCENTRATED, MOST = 10.0, 0.9


@dataclass(frozen=True)
class LoadSymbol:
    """One load of a drawing.

    Attributes
    ----------
    nodes : array of int, (n,)
        Loaded nodes.
    at : array, (d,)
        Point of application in m: the mean position of the nodes, weighted by their forces.
    force : array, (d,)
        Resultant in N.
    distributed : bool
        Whether it is a distributed load.
    inside : bool
        Whether it also acts on nodes inside the body.
    """

    nodes: NDArray[np.int64]
    at: Array
    force: Array
    distributed: bool = False
    inside: bool = False


def load_symbols(mesh: Mesh, x: Array, force: Array) -> list[LoadSymbol]:
    """Find the symbols of nodal forces.

    Parameters
    ----------
    mesh : Mesh
    x, force : array, (n_nodes, d)
        Drawn positions of the nodes in m, and forces in N.
    """
    magnitude = np.linalg.norm(force, axis=1)
    boundary = np.unique(boundary_facets(mesh.cells, mesh.cell_type))
    symbols = []
    for patch in _patches(mesh, magnitude > 0):
        single = np.full(len(patch), len(patch) <= FEW)
        single |= magnitude[patch] > CONCENTRATED * np.quantile(magnitude[patch], MOST)
        symbols += [
            LoadSymbol(patch[[i]], x[patch[i]], force[patch[i]]) for i in single.nonzero()[0]
        ]
        rest = patch[~single]
        if len(rest):
            at = np.average(x[rest], axis=0, weights=magnitude[rest])
            inside = not np.isin(rest, boundary).all()
            symbols.append(LoadSymbol(rest, at, force[rest].sum(axis=0), True, inside))
    return symbols


def _patches(mesh: Mesh, loaded: NDArray[np.bool_]) -> list[NDArray[np.int64]]:
    """Sets of loaded nodes that hang together by cells, in the order of their lowest nodes."""
    cell, corner = np.nonzero(loaded[mesh.cells])
    nodes, count = mesh.cells[cell, corner], len(loaded)
    patch = components(nodes, count + cell, count + len(mesh.cells))[:count]
    return [np.flatnonzero(loaded & (patch == number)) for number in np.unique(patch[loaded])]
