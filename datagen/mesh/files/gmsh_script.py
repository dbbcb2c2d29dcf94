"""Commands of gmsh scripts that act outside gmsh, which are refused unless the user trusts them.

A ``.geo`` file is a program: it can run shell commands, write files, read other files and ask
questions. gmsh also runs any other file that it does not recognise as a mesh.
"""

from __future__ import annotations

import re
from pathlib import Path

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
MESH = (b"$MeshFormat", b"$NOD", b"$Comments")  # beginnings of files that gmsh reads as a mesh


def require_harmless(path: Path) -> None:
    """Raise ValueError if gmsh would do more with a file than to make or read a mesh.

    Parameters
    ----------
    path : Path
        A ``.geo`` or ``.msh`` file.
    """
    content = path.read_bytes()
    if path.suffix.lower() != ".geo":
        if not content.startswith(MESH):
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
