"""gmsh sessions, and the mesh of a gmsh model as arrays."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from types import MappingProxyType
from typing import Any

import numpy as np

from datagen.mesh.groups import Group
from datagen.mesh.raw_mesh import raw_mesh
from datagen.needed import GMSH
from shared_schema.common.bodies.groups import KINDS, RawMesh
from shared_schema.common.errors import WorkError, first_line

MESHIO_NAMES = {1: "line", 2: "triangle", 3: "quad", 4: "tetra", 5: "hexahedron", 15: "vertex"}


@contextmanager
def gmsh_session(parameters: Mapping[str, float] = MappingProxyType({})) -> Iterator[Any]:
    """Start gmsh without output, yield its module, and finalize it afterwards.

    gmsh has one session in a process, so sessions must not be nested.

    Parameters
    ----------
    parameters : mapping of str to float
        Constants that take the place of those of a script's ``DefineConstant``.

    Raises
    ------
    WorkError
        If gmsh is not installed.
    """
    try:
        import gmsh
    except (ImportError, OSError) as error:  # a library of the desktop is not there
        raise WorkError(f"a mesh needs gmsh ({first_line(error)}); {GMSH}") from None

    pairs = [("-setnumber", name, repr(value)) for name, value in parameters.items()]
    gmsh.initialize(["gmsh", *(text for pair in pairs for text in pair)])
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.model.add("mesh")
        yield gmsh
    finally:
        gmsh.finalize()


def generate(gmsh: Any, dimension: int) -> None:
    """Mesh the current model of gmsh.

    Raises
    ------
    ValueError
        If gmsh fails, with its reason and the place.
    """
    try:
        gmsh.model.mesh.generate(dimension)
    except Exception as error:  # gmsh raises nothing more special
        failed = gmsh.model.mesh.getLastEntityError()
        where = ""
        if failed:
            box = np.reshape(gmsh.model.getBoundingBox(*failed[0]), (2, 3))
            kind = KINDS[failed[0][0]]
            corners = " to ".join(",".join(f"{x:g}" for x in corner.round(6)) for corner in box)
            where = f" of {kind} {failed[0][1]} at {corners}"
        raise ValueError(
            f"gmsh makes no mesh{where} ({first_line(error).strip()}), expected closed bodies "
            "whose sides neither cut nor cover each other"
        ) from None


def mesh_of(model: Any) -> RawMesh:
    """Convert the mesh of a gmsh model to arrays, nodes in the order of their tags.

    If physical groups of the highest dimension are defined, the mesh consists of their cells,
    otherwise of all cells. Every physical group becomes a group of nodes, under its name or number
    (`datagen.mesh.groups.by_name`), with its facets or cells.

    Raises
    ------
    ValueError
        If the mesh is unfit, see `raw_mesh`.
    """
    tags, points, _ = model.mesh.getNodes()
    order = np.argsort(tags)
    tags, points = tags[order], points.reshape(-1, 3)[order]
    dimension = max((dim for dim, _ in model.getEntities() if _has_cells(model, dim)), default=0)
    bodies = defaultdict[int, dict[str, set[int]]](dict)  # entities of the groups, by dimension
    for dim, tag in model.getPhysicalGroups():
        name = model.getPhysicalName(dim, tag) or str(tag)
        entities = set(model.getEntitiesForPhysicalGroup(dim, tag).tolist())
        bodies[dim][name] = bodies[dim].get(name, set()) | entities
    blocks, cell_sets = [], defaultdict[str, list[Any]](list)
    names = {name for of_dimension in bodies.values() for name in of_dimension}
    for dim in range(1, dimension + 1):
        of_groups = sorted(set().union(*bodies[dim].values()))
        for entity in of_groups or [-1] * (dim == dimension):
            for kind, _, nodes in zip(*model.mesh.getElements(dim, entity), strict=True):
                name, _, _, corners, _, _ = model.mesh.getElementProperties(kind)
                cells = np.searchsorted(tags, nodes).reshape(-1, corners)
                blocks.append((MESHIO_NAMES.get(kind, str(name)), cells))
                for group in names:
                    inside = entity in bodies[dim].get(group, ())
                    cell_sets[group].append(np.arange(len(cells)) if inside else None)
    groups: dict[Group, Any] = {}
    for dim, tag in model.getPhysicalGroups():
        key = dim, model.getPhysicalName(dim, tag) or str(tag)
        members = np.searchsorted(tags, model.mesh.getNodesForPhysicalGroup(dim, tag)[0])
        groups[key] = np.union1d(groups.get(key, members), members)
    return raw_mesh(points, blocks, groups, cell_sets, tags.astype(np.int64))


def _has_cells(model: Any, dimension: int) -> bool:
    """True if the model has cells of a dimension."""
    return len(model.mesh.getElements(dimension)[0]) > 0
