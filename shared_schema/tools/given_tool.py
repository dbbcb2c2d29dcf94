"""Tools as commands take them."""

from __future__ import annotations

from collections.abc import Mapping

from shared_schema.common.errors import InputError
from shared_schema.tools.closed_surface import Mesh
from shared_schema.tools.tool import Capsule, Plane, Sphere, Tool

Numbers = tuple[float, ...]


def parse_tool(text: str, dimension: int, meshes: Mapping[str, Mesh] | None = None) -> Tool:
    """Read a tool from a text, such as ``sphere:2,1.1,0.5:0.2``.

    Parameters
    ----------
    text : str
    dimension : int
    meshes : mapping of str to Mesh, optional
        What ``mesh:NAME`` means, with a place and a turn; then no file is read. Without it, NAME is
        a file.

    Raises
    ------
    InputError
        If it is none, or not of the body's dimension.
    """
    kind, *parts = text.split(":")
    path = parts.pop(0) if kind == "mesh" and parts else ""
    forms = ", ".join((Sphere.form, Capsule.form, Plane.form, Mesh.form))
    try:
        numbers = [tuple(float(value) for value in part.split(",")) for part in parts]
    except ValueError:
        kind, numbers = "", []
    tool: Tool
    try:
        if kind == "sphere" and [len(each) for each in numbers[1:]] == [1]:
            tool = Sphere(numbers[0], numbers[1][0])
        elif kind == "capsule" and [len(each) for each in numbers[2:]] == [1]:
            tool = Capsule(numbers[0], numbers[1], numbers[2][0])
        elif kind == "plane" and len(numbers) == 2:
            tool = Plane(*numbers)
        elif kind == "mesh":
            tool = _mesh(path, numbers) if meshes is None else _moved(path, numbers, meshes)
        else:
            raise InputError(f"expected one of {forms}")
    except InputError as error:
        raise InputError(f"--tool {text}: {error}") from None
    if tool.dimension != dimension:
        raise InputError(f"--tool {text}: expected points of {dimension} components")
    return tool


def _mesh(path: str, numbers: list[Numbers]) -> Mesh:
    """The mesh of a file, with its place, turn and scale, as far as they are given."""
    if not path or [len(each) for each in numbers] != [3, 3, 1][: len(numbers)]:
        raise InputError(f"expected {Mesh.form}")
    poses = [*numbers[:2], (0.0,) * 3, (0.0,) * 3]
    return Mesh(path, poses[0], poses[1], numbers[2][0] if numbers[2:] else 1.0)


def _moved(name: str, numbers: list[Numbers], meshes: Mapping[str, Mesh]) -> Mesh:
    """A mesh that there is, with its place and turn, as far as they are given."""
    if name not in meshes or [len(each) for each in numbers] != [3, 3][: len(numbers)]:
        names = ", ".join(sorted(meshes)) or "none"
        raise InputError(f"expected mesh:NAME[:X,Y,Z[:RX,RY,RZ]], the meshes are {names}")
    return meshes[name].moved(*[*numbers, (0.0,) * 3][:2])
