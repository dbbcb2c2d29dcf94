"""Violations in the values of one shard whose shapes are right: loads, supports, results, grid."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from shared_schema.common.bodies.cells import boundary_facets
from shared_schema.common.bodies.points_between import PointsBetween
from shared_schema.layout import NO_NODE, Arrays
from shared_schema.manifest import Manifest

OF_SHAPES = "mesh/shape_terms", "mesh/parameter_names", "samples/parameters"
UNIT = 1e-9  # largest difference of the length of a direction from 1


def content_problems(manifest: Manifest, arrays: Arrays) -> list[str]:
    """List what is wrong with the values: node numbers, load cases, the grid."""
    problems = []
    nodes = len(arrays["mesh/coordinates"])
    for name in ("mesh/cells", "samples/loaded_nodes", "failed/loaded_nodes"):
        if name in arrays and arrays[name].size:
            lowest = 0 if name == "mesh/cells" else NO_NODE
            if arrays[name].min() < lowest or arrays[name].max() >= nodes:
                problems.append(f"dataset '{name}' names a node outside 0 … {nodes - 1}")
    if not problems:
        for group in ("samples", "failed"):
            if f"{group}/loaded_nodes" in arrays:
                problems += _load_problems(arrays, group)
        problems += _support_problems(arrays) + body_problems(arrays)
    if manifest.forces is None and "samples/force_between" in arrays:
        problems.append("dataset 'samples/force_between' stands against the manifest's 'forces'")
    problems += _actuator_problems(manifest, arrays)
    if manifest.kind == "nodal":
        problems += _result_problems(arrays)
    if manifest.structured is None:
        return problems
    if ("grid/sources" in arrays) != (manifest.structured.embedding is not None):
        problems.append("the grid is embedded, or not, against what the manifest says")
    return problems + grid_problems(arrays, manifest.structured.grid_shape)


def _load_problems(arrays: Arrays, group: str) -> list[str]:
    """Name padding before a loaded node or under force, clamped loaded nodes, and repeated ones."""
    force = "samples/nodal_force" if "samples/nodal_force" in arrays else f"{group}/force"
    name, nodes = f"{group}/loaded_nodes", arrays[f"{group}/loaded_nodes"]
    is_padding = nodes == NO_NODE
    problems = []
    if np.any(is_padding[:, :-1] & ~is_padding[:, 1:]):
        problems.append(f"dataset '{name}' has padding before a loaded node")
    if np.any(arrays[force][is_padding]):
        problems.append(f"dataset '{force}' is not zero where '{name}' is padding")
    if np.any(arrays["mesh/clamped"][nodes[~is_padding]]):
        problems.append(f"dataset '{name}' names a clamped node")
    elif not np.all(arrays["mesh/loadable"][nodes[~is_padding]]):
        problems.append(f"dataset '{name}' names a node that is not loadable")
    ordered = np.sort(nodes, axis=1)
    if np.any((ordered[:, 1:] == ordered[:, :-1]) & (ordered[:, 1:] != NO_NODE)):
        problems.append(f"dataset '{name}' names a node twice in one load case")
    return problems


def _actuator_problems(manifest: Manifest, arrays: Arrays) -> list[str]:
    """Name values of actuators that the case has not, or that no cable or chamber can have."""
    count = len(manifest.case.get("actuators") or {})
    names = [f"samples/{name}" for name in ("actuation", "amplitude", "quantity")]
    found = [arrays[name] for name in names if name in arrays]
    if not found and (count == 0 or not len(arrays["samples/number"])):
        return []
    if len(found) < len(names) or any(values.shape[1] != count for values in found):
        return [f"datasets '{names[0]}' … of the {count} actuators stand together"]
    problems = [
        f"dataset '{name}' has a number that is not finite"
        for name, values in zip(names, found, strict=True)
        if not np.isfinite(values).all()
    ]
    if not np.all(found[-1] > 0):
        problems.append(f"dataset '{names[-1]}' has a length or volume of 0 or below")
    return problems


def _support_problems(arrays: Arrays) -> list[str]:
    """Name displacements of clamped nodes: at the nodes, or at the grid points that are nodes."""
    clamped = arrays["mesh/clamped"]
    for name in ("samples/nodal_displacement", "samples/displacement"):
        values = arrays.get(name)
        if values is None:
            continue
        if values.shape[1:] == (len(clamped), arrays["mesh/coordinates"].shape[1]):
            moved = values[:, clamped]
        elif "grid/node_at" in arrays:
            node_at = arrays["grid/node_at"]
            inside = (node_at >= 0) & (node_at < len(clamped))
            moved = values[..., inside & clamped[np.where(inside, node_at, 0)]]
        else:
            continue
        if np.any(moved):
            return [f"dataset '{name}' moves a clamped node"]
    return []


def _result_problems(arrays: Arrays) -> list[str]:
    """Name results that no solver gives: reasons, counts, times and norms out of their range."""
    problems = []
    for name, lowest, highest in (
        ("samples/converged_reason", 2, 7),  # those of convergence in PETSc
        ("samples/load_steps", 1, np.inf),
        ("samples/cutbacks", 0, np.inf),
        ("samples/newton_iterations", 0, np.inf),
        ("samples/residual_norm", 0, np.inf),
        ("samples/wall_time", 0, np.inf),
        ("failed/load_factor", 0, 1),
    ):
        values = arrays[name]
        if values.size and (values.min() < lowest or values.max() > highest):
            wrong = values[(values < lowest) | (values > highest)][0]
            expected = f"at least {lowest}" if highest == np.inf else f"{lowest} to {highest}"
            problems.append(f"dataset '{name}' is {wrong}, expected {expected}")
    if not all(arrays["failed/reason"]):
        problems.append("dataset 'failed/reason' has an empty text")
    return problems


def body_problems(arrays: Arrays) -> list[str]:
    """List what is wrong with held components, groups, materials of cells, and distributed loads.

    The arrays have right shapes, and loaded nodes are nodes of the mesh.
    """
    return [
        *_held(arrays),
        *_groups(arrays),
        *_materials(arrays),
        *_fibres(arrays),
        *_pressures(arrays),
        *_forces_between(arrays),
        *_shapes(arrays),
    ]


def _shapes(arrays: Arrays) -> list[str]:
    """Name parameters outside of their ranges, and node positions that are not those of theirs."""
    if not any(name.startswith(OF_SHAPES) for name in arrays):
        return []
    from shared_schema.common.bodies.shape_family import ShapeFamily

    shapes, parameters = ShapeFamily.of_arrays(arrays), arrays.get("samples/parameters")
    if shapes is None or parameters is None:
        return [f"datasets {', '.join(f'{name!r}' for name in OF_SHAPES)} do not stand together"]
    if not np.array_equal(shapes.terms[0], arrays["mesh/coordinates"]):
        return ["dataset 'mesh/shape_terms' does not begin with 'mesh/coordinates'"]
    positions = arrays.get("samples/coordinates", [None] * len(parameters))
    size = UNIT * float(np.ptp(shapes.terms[0], axis=0).max())
    for values, x in zip(parameters, positions, strict=True):
        if outside := shapes.outside(values):
            return [f"dataset 'samples/parameters': {outside[0]}"]
        if x is not None and np.abs(x - shapes.coordinates(values)).max() > size:
            return ["dataset 'samples/coordinates' is not the shape of 'samples/parameters'"]
    return []


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
    """Name groups without their other half, names that occur twice, and other numbers of facets."""
    names, groups = arrays.get("mesh/group_names"), arrays.get("mesh/groups")
    if (names is None) != (groups is None):
        return ["datasets 'mesh/group_names' and 'mesh/groups' do not stand together"]
    if names is not None and len(set(names.tolist())) < len(names):
        return ["dataset 'mesh/group_names' has a name twice"]
    facets, cell_type = arrays.get("mesh/group_facets"), _cell_type(arrays)
    if (facets is None) != ("mesh/group_cells" not in arrays) or (
        facets is not None and groups is None
    ):
        return ["datasets 'mesh/groups', 'mesh/group_facets' and 'mesh/group_cells' stand together"]
    if facets is None or not cell_type:
        return []
    count = len(boundary_facets(arrays["mesh/cells"], cell_type))
    if facets.shape[1] != count:
        return [f"dataset 'mesh/group_facets' has {facets.shape[1]} facets, the surface {count}"]
    return []


def _materials(arrays: Arrays) -> list[str]:
    values = arrays.get("mesh/material")
    if values is not None and values.size and values.min() < 0:
        return [f"dataset 'mesh/material' is {values.min()}, expected 0 at least"]
    return []


def _fibres(arrays: Arrays) -> list[str]:
    """Name directions that are neither of length 1 nor 0."""
    values = arrays.get("mesh/fibres")
    if values is None:
        return []
    lengths = np.linalg.norm(values, axis=2)
    fit = (lengths == 0) | (np.abs(lengths - 1) < UNIT)
    if fit.all():
        return []
    cell, family = np.argwhere(~fit)[0]
    return [
        f"dataset 'mesh/fibres' has a vector of length {lengths[cell, family]:g} in cell {cell}, "
        "expected 1, or 0 for none"
    ]


def _pressures(arrays: Arrays) -> list[str]:
    """Name facets that are not on the surface, and pressures without their facets."""
    facets, of = arrays.get("mesh/pressed"), arrays.get("mesh/pressed_surface")
    if (facets is None) != (of is None) or ("samples/pressure" in arrays and of is None):
        return ["datasets 'mesh/pressed', 'mesh/pressed_surface' and the pressures stand together"]
    if facets is None or of is None:
        return []
    cells, problems, cell_type = arrays["mesh/cells"], [], _cell_type(arrays)
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


def _forces_between(arrays: Arrays) -> list[str]:
    """Name forces between the nodes that are not on the points there, or that supports bear."""
    names = [f"{group}/force_between" for group in ("samples", "failed")]
    names, cell_type = [name for name in names if name in arrays], _cell_type(arrays)
    if not names or cell_type is None:
        return []
    nodes, dimension = arrays["mesh/coordinates"].shape
    points = PointsBetween.of(arrays["mesh/cells"], cell_type, nodes)
    clamped = np.repeat(arrays["mesh/clamped"][:, None], dimension, axis=1)
    held = points.held(arrays.get("mesh/held", clamped))[nodes:]
    problems = []
    for name in names:
        count = arrays[name].shape[1]
        if count != points.between:
            problems.append(f"dataset '{name}' has {count} points, expected {points.between}")
        elif np.any(arrays[name][:, held]):
            problems.append(f"dataset '{name}' has a force on a held component")
    return problems


def _cell_type(arrays: Arrays) -> str | None:
    """Meshio's name of the cells."""
    kind = {(2, 3): "triangle", (2, 4): "quad", (3, 4): "tetra", (3, 8): "hexahedron"}
    return kind.get((arrays["mesh/coordinates"].shape[1], arrays["mesh/cells"].shape[1]))


def grid_problems(arrays: Arrays, shape: tuple[int, ...]) -> list[str]:
    """List what is wrong with the grid of a structured shard whose array shapes are right.

    Parameters
    ----------
    arrays : mapping of str to array
    shape : tuple of int
        Shape of the grid in the manifest.
    """
    name = "grid/node_at" if "grid/node_at" in arrays else "grid/sources"
    node_at = arrays[name] if name == "grid/node_at" else arrays[name][..., 0]
    if node_at.shape != shape:
        return [f"dataset '{name}' has shape {node_at.shape}, the manifest says {shape}"]
    mask = node_at != NO_NODE
    problems = []
    if name == "grid/sources":
        problems += _embedding_problems(arrays, mask)
    elif not np.array_equal(np.sort(node_at[mask]), np.arange(len(arrays["mesh/coordinates"]))):
        problems.append(f"dataset '{name}' does not place every node exactly once")
    if not np.array_equal(mask, arrays["grid/mask"]):
        problems.append("dataset 'grid/mask' is not that of the map from nodes to grid")
    for field in ("samples/force", "samples/displacement"):
        if np.any(arrays[field][..., ~mask]):
            problems.append(f"dataset '{field}' is not zero where the grid has no value")
    return problems


def _embedding_problems(arrays: Arrays, mask: NDArray[np.bool_]) -> list[str]:
    """Name numbers out of range, and interpolations that do not reproduce a constant."""
    problems = []
    for name, numbers, count in (
        ("sources", arrays["grid/sources"][mask], len(arrays["mesh/coordinates"])),
        ("points", arrays["grid/points"], mask.size),
    ):
        if numbers.size and (numbers.min() < 0 or numbers.max() >= count):
            problems.append(f"dataset 'grid/{name}' names one outside 0 … {count - 1}")
    for name, weights in (
        ("source_weights", arrays["grid/source_weights"][mask]),
        ("point_weights", arrays["grid/point_weights"]),
    ):
        if not np.allclose(weights.sum(axis=-1), 1.0, rtol=0, atol=1e-9):
            problems.append(f"dataset 'grid/{name}' has rows that do not sum to 1")
    return problems
