"""Meshes of all formats that meshio reads, with their named sets, families and numbered cells."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from datagen.mesh.groups import Group
from datagen.mesh.raw_mesh import raw_mesh
from shared_schema.common.bodies.groups import RawMesh
from shared_schema.tools.closed_surface import read_by_meshio

NASTRAN = (".bdf", ".fem", ".nas")
NUMBERED = (  # formats that number their nodes, which meshio does not tell
    *(".avs", ".dato", ".dato.gz", ".e", ".ele", ".ex2", ".exo", ".f3grid", ".mdpa", ".med"),
    *(".node", ".post", ".post.gz"),
)
MOST = 100  # different numbers of cell data that are groups; more are numbers of cells


def mesh_by_meshio(path: Path) -> RawMesh:
    """Read a file by meshio.

    Its sets of points and cells become groups, the families of MED as well, and every number of
    cell data of whole numbers: under the number, or such as ``material 3`` if there are several.

    Raises
    ------
    ValueError
        If meshio cannot read the file, with its reason, or the mesh is unfit.
    """
    try:
        mesh = read_by_meshio(path)
    except ValueError as error:
        raise ValueError(f"meshio finds no mesh with cells in it ({error})") from None
    blocks = [(block.type, np.asarray(block.data, dtype=np.int64)) for block in mesh.cells]
    groups: dict[Group, Any] = {(0, name): np.asarray(m) for name, m in mesh.point_sets.items()}
    if "point_tags" in mesh.point_data:
        members = _families(mesh, "point_tags", np.asarray(mesh.point_data["point_tags"]))
        groups |= {(0, name): np.flatnonzero(chosen) for name, chosen in members.items()}
    ends = np.cumsum([len(cells) for _, cells in blocks])[:-1]
    cell_sets: dict[str, list[Any]] = {
        name: [np.flatnonzero(part) for part in np.split(chosen, ends)]
        for name, chosen in _cell_masks(mesh).items()
    }
    cell_sets |= {name: list(members) for name, members in mesh.cell_sets.items()}
    labels = _nastran_labels(path) if path.suffix.lower() in NASTRAN else None
    return raw_mesh(
        np.asarray(mesh.points, dtype=np.float64),
        blocks,
        {group: np.asarray(members, dtype=np.int64) for group, members in groups.items()},
        cell_sets,
        labels,
        is_numbered=not path.name.lower().endswith(NUMBERED),
    )


def _families(mesh: Any, kind: str, tags: NDArray[Any]) -> dict[str, NDArray[np.bool_]]:
    """Members of the named families of a MED file among points or cells with some tags."""
    found: dict[str, NDArray[np.bool_]] = {}
    for tag, names in getattr(mesh, kind, {}).items():
        for name in names:
            found[name] = found.get(name, np.zeros(len(tags), dtype=bool)) | (tags == tag)
    return found


def _cell_masks(mesh: Any) -> dict[str, NDArray[np.bool_]]:
    """Members of families and of numbers of cell data, among the cells of all blocks in turn."""
    data = {name: np.concatenate(list(parts)) for name, parts in mesh.cell_data.items()}
    found = _families(mesh, "cell_tags", data["cell_tags"]) if "cell_tags" in data else {}
    if found:
        del data["cell_tags"]
    numbered = {
        name: np.unique(values)
        for name, values in data.items()
        if values.ndim == 1 and np.issubdtype(values.dtype, np.integer)
    }
    numbered = {name: numbers for name, numbers in numbered.items() if len(numbers) <= MOST}
    for name, numbers in numbered.items():
        for number in numbers.tolist():
            group = str(number) if len(numbered) == 1 else f"{name} {number}"
            found.setdefault(group, data[name] == number)
    return found


def _nastran_labels(path: Path) -> NDArray[np.int64]:
    """Numbers of the grid points of a Nastran file, in the order of the file."""
    labels = []
    for line in path.read_text(errors="replace").splitlines():
        if not line.startswith("GRID"):
            continue
        wide = 16 if line.startswith("GRID*") else 8
        number, system = line[8 : 8 + wide], line[8 + wide : 8 + 2 * wide]
        if "," in line:
            _, number, system, *_ = [*line.split(","), ""]
        if system.strip() not in ("", "0"):
            raise ValueError(
                f"GRID {number.strip()}: coordinates of the system {system.strip()}, expected "
                "those of the basic one"
            )
        labels.append(int(number))
    return np.array(labels, dtype=np.int64)
