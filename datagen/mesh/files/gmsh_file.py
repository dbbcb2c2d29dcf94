"""Mesh of a gmsh script (``.geo``), or of a gmsh mesh (``.msh``)."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from datagen.mesh.files.msh2_file import is_msh2, mesh_of_msh2
from datagen.mesh.gmsh_model import generate, gmsh_session, mesh_of
from datagen.mesh.raw_mesh import require_different
from shared_schema.common.bodies.groups import RawMesh

SCRIPT, MESH = ".geo", ".msh"
FORMAT = re.compile(rb"\$MeshFormat\s+\d+(?:\.\d+)?\s+([01])\s")
ELEMENTS = re.compile(rb"\$(?:Elements|ELM)[ \t]*\r?\n")


def is_script(path: Path | str) -> bool:
    """True if a file name ends as that of a gmsh script."""
    return Path(path).suffix.lower() == SCRIPT


def is_of_gmsh(path: Path | str) -> bool:
    """True if a file name ends as that of a gmsh script or mesh."""
    return Path(path).suffix.lower() in (SCRIPT, MESH)


def mesh_by_gmsh(path: Path, parameters: Mapping[str, float]) -> RawMesh:
    """Read a mesh, or generate that of a script with values of its constants.

    Raises
    ------
    ValueError
        If gmsh cannot open or mesh the file, the mesh is unfit, or gmsh reads fewer elements than
        stand in the file.
    """
    content = path.read_bytes()
    if is_script(path) and not content.endswith(b"\n"):
        raise ValueError(
            "expected a line feed at the end, gmsh leaves out what stands after the last"
        )
    if is_msh2(content):
        return mesh_of_msh2(content)
    with gmsh_session(parameters) as gmsh:
        gmsh.open(str(path))
        if len(gmsh.model.mesh.getElements()[0]) == 0:
            generate(gmsh, gmsh.model.getDimension())
        elif not is_script(path):
            _require_all(gmsh.model, content)
        return mesh_of(gmsh.model)


def _require_all(model: Any, content: bytes) -> None:
    """Raise ValueError unless the model has as many elements as its file says, all different."""
    elements = np.concatenate(model.mesh.getElements()[1]).astype(np.int64)
    require_different("element", elements)
    said = _element_count(content)
    if said not in (None, len(elements)):
        raise ValueError(
            f"the file has {said} elements, of which gmsh reads {len(elements)}: expected each "
            "number of an element once"
        )


def _element_count(content: bytes) -> int | None:
    """Number of elements that a file of format 1 or 4 says it has."""
    head, section = FORMAT.search(content), ELEMENTS.search(content)
    if section is None:
        return None
    if head is not None and head[1] == b"1":
        return int(np.frombuffer(content, "<u8", 2, section.end())[1])
    numbers = content[section.end() : section.end() + 100].splitlines()[0].split()
    return int(numbers[min(1, len(numbers) - 1)])  # in format 4 after the number of blocks
