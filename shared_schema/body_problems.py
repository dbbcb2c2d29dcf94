"""Violations in the arrays that only some bodies have: the optional ones of the layout."""

from __future__ import annotations

import numpy as np

from shared_schema.common.bodies.cells import boundary_facets
from shared_schema.layout import NO_NODE, Arrays


def body_problems(arrays: Arrays) -> list[str]:
    """List what is wrong with held components, groups, materials of cells, and pressures.

    Parameters
    ----------
    arrays : dict of array
        Arrays of a shard, of right shapes, whose loaded nodes are nodes of the mesh.
    """
    return [*_held(arrays), *_groups(arrays), *_materials(arrays), *_pressures(arrays)]


def _held(arrays: Arrays) -> list[str]:
    """Name components that do not fit the clamped nodes, or that move or are loaded."""
    if "mesh/held" not in arrays:
        return []
    held, problems = arrays["mesh/held"], []
    if not np.array_equal(held.all(axis=1), arrays["mesh/clamped"]):
        problems.append("dataset 'mesh/held' is not all true at the clamped nodes alone")
    for name in ("samples/nodal_displacement", "samples/displacement"):
        values = arrays.get(name)
        if values is not None and values.shape[1:] == held.shape and np.any(values[:, held]):
            problems.append(f"dataset '{name}' moves a held component")
    for group in ("samples", "failed"):
        force = "samples/nodal_force" if "samples/nodal_force" in arrays else f"{group}/force"
        nodes = arrays.get(f"{group}/loaded_nodes")
        if nodes is not None and np.any(arrays[force][(nodes != NO_NODE)[..., None] & held[nodes]]):
            problems.append(f"dataset '{force}' has a force on a held component")
    return problems


def _groups(arrays: Arrays) -> list[str]:
    """Name groups without their other half, and names that occur twice."""
    names, groups = arrays.get("mesh/group_names"), arrays.get("mesh/groups")
    if (names is None) != (groups is None):
        return ["datasets 'mesh/group_names' and 'mesh/groups' do not stand together"]
    if names is not None and len(set(names.tolist())) < len(names):
        return ["dataset 'mesh/group_names' has a name twice"]
    return []


def _materials(arrays: Arrays) -> list[str]:
    values = arrays.get("mesh/material")
    if values is not None and values.size and values.min() < 0:
        return [f"dataset 'mesh/material' is {values.min()}, expected 0 at least"]
    return []


def _pressures(arrays: Arrays) -> list[str]:
    """Name facets that are not on the surface, and pressures without their facets."""
    facets, of = arrays.get("mesh/pressed"), arrays.get("mesh/pressed_surface")
    if (facets is None) != (of is None) or ("samples/pressure" in arrays and of is None):
        return ["datasets 'mesh/pressed', 'mesh/pressed_surface' and the pressures stand together"]
    if facets is None or of is None:
        return []
    cells, problems = arrays["mesh/cells"], []
    kind = {(2, 3): "triangle", (2, 4): "quad", (3, 4): "tetra", (3, 8): "hexahedron"}
    cell_type = kind.get((arrays["mesh/coordinates"].shape[1], cells.shape[1]))
    surface = boundary_facets(cells, cell_type) if cell_type else facets
    known = {tuple(sorted(facet)) for facet in surface.tolist()}
    if any(tuple(sorted(facet)) not in known for facet in facets.tolist()):
        problems.append("dataset 'mesh/pressed' names a facet that is not on the surface")
    for group in ("samples", "failed"):
        pressure = arrays.get(f"{group}/pressure")
        if pressure is not None and not np.array_equal(np.unique(of), np.arange(pressure.shape[1])):
            problems.append("dataset 'mesh/pressed_surface' does not number the surfaces in turn")
            break
    return problems
