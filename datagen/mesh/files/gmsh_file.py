"""Mesh of a gmsh script (``.geo``), or of a gmsh mesh (``.msh``).

A script is a program: it can run shell commands, write files, read other files and ask questions.
Such commands are refused unless the user trusts it. gmsh also runs any other file that it does not
recognise as a mesh.
"""

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

RUN = ("SystemCall", "System", "NonBlockingSystemCall", "OnelabRun", "ExternalProcess")
WRITE = ("Save", "SaveMesh", "Print", "CreateDir", "Plugin")
READ = ("Include", "Merge", "MergeFile", "MergeWithBoundingBox", "Open", "ShapeFromFile")
ASK = ("GetValue", "GetString", "GetEnv", "Exit")
ANYWHERE = re.compile(rf"\b({'|'.join(RUN)})\b|(\0)")  # a NUL ends a comment
IN_CODE = (
    re.compile(rf"(?<![\w.])({'|'.join((*WRITE, *READ, *ASK))})\b"),
    re.compile(r"(?<![\w.])(Printf|Error|Warning)\b[^;]*\)\s*>"),  # to a file
    re.compile(r"\.\s*(\w*(?:FileName|CommandLine|Executable|Command|InitialModule)\w*)"),
    re.compile(r"(')"),  # the other kind of string, in which quotation marks may stand
)
SKIPPED = re.compile(r"/\*.*?\*/|//[^\n]*|\"[^\"\n]*\"", re.DOTALL)  # comments and strings
CONSTANTS = re.compile(r"\bDefineConstant\s*\[(.*?)\]\s*;", re.DOTALL)
BRACES = re.compile(r"\{[^{}]*\}")
NAMED = re.compile(r"(?:^|,)\s*([A-Za-z_]\w*)\s*(?:=|,|$)")
BEGINNINGS = (
    b"$MeshFormat",
    b"$NOD",
    b"$Comments",
)  # beginnings of files that gmsh reads as a mesh
SCRIPT, MESH = ".geo", ".msh"
FORMAT = re.compile(rb"\$MeshFormat\s+\d+(?:\.\d+)?\s+([01])\s")
ELEMENTS = re.compile(rb"\$(?:Elements|ELM)[ \t]*\r?\n")


def require_harmless(path: Path) -> None:
    """Raise ValueError if gmsh would do more with a file than to make or read a mesh.

    Parameters
    ----------
    path : Path
        A ``.geo`` or ``.msh`` file.
    """
    content = path.read_bytes()
    if path.suffix.lower() != ".geo":
        if not content.startswith(BEGINNINGS):
            raise ValueError("expected a mesh, which begins with '$MeshFormat'")
        return
    text = content.decode("latin-1")
    code = _code(text)
    for pattern, where in ((ANYWHERE, text), *((pattern, code) for pattern in IN_CODE)):
        found = pattern.search(where)
        if found:
            line = where.count("\n", 0, found.start()) + 1
            raise ValueError(
                f"line {line}: {found[0].strip()!r} can run programs, write or read other files or "
                "ask questions, expected commands that make a mesh; --trust allows all"
            )


def constants_of(path: Path) -> set[str]:
    """Names of the constants that a ``.geo`` file defines by ``DefineConstant[name = …];``."""
    names: set[str] = set()
    for block in CONSTANTS.findall(_code(path.read_bytes().decode("latin-1"))):
        names |= set(NAMED.findall(BRACES.sub(" ", block)))
    return names


def _code(text: str) -> str:
    """Text of a script without comments and strings, in the same lines."""
    return SKIPPED.sub(lambda skipped: re.sub(r"[^\n]", " ", skipped[0]), text)


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
