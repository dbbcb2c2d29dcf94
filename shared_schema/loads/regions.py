"""Regions select nodes by coordinates, named groups or numbers, or as those of the surface.

Examples are ``{x: "> 0", y: 1}``, ``{z: "> 0 and < 0.1"}``, ``{sphere: [0, 0, 1, 0.2]}``,
``{patch: [0, 0, 1, 0.2]}``, ``{group: name}``, ``{nodes: clamped.txt, nodes_from: 1}`` and
``{boundary: true, x: "> 0"}``.
"""

from __future__ import annotations

import math
import operator
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, ValidationInfo, field_validator, model_validator

from shared_schema.common.bodies.groups import missing_group
from shared_schema.common.configuration import Frozen, absent

AXES = ("x", "y", "z")
COMPARISONS = {
    ">": operator.gt,
    "<": operator.lt,
    ">=": operator.ge,
    "<=": operator.le,
}
CONDITION = re.compile(r"^\s*(>=|<=|>|<)\s*(\S+)\s*$")
NodeNumbers = tuple[Annotated[int, Field(ge=0, lt=2**62)], ...]
LARGEST_FILE = 50_000_000  # bytes
ANGLE = 45.0  # of a patch, in degrees
RELATIVE_TOLERANCE = 1e-6  # of the longest side of the mesh's bounding box


class Region(Frozen):
    """Set of the nodes that meet all given conditions.

    Attributes
    ----------
    group : str or None
        Name of a group of the mesh: a physical group of gmsh, or a node or element set. If unlike
        groups have one name, ``curve 1`` or ``volume 1`` is one of them; supports and loads on the
        surface mean the one that is not of the cells of the body.
    nodes : tuple of int, optional
        Numbers of nodes in the file of the mesh, or the path of a text file of them, relative to
        the case file.
    nodes_from : 0 or 1, optional
        Number of the first node of the mesh; expected with `nodes`. It is 1 for files that number
        their nodes from another number on, with gaps or out of order.
    boundary : bool
        Only nodes of the surface: those of facets that belong to one cell. Loads leave clamped
        nodes out.
    sphere : tuple of float, optional
        Centre and radius in m, d + 1 numbers: only nodes inside, or on, this sphere or disc.
    plane : tuple of float, optional
        A point in m and a normal, 2 d numbers: only nodes on this plane or line, or behind it.
    patch : tuple of float, optional
        A position and a radius in m, d + 1 numbers: only nodes of the surface around the node of it
        that is nearest to the position, within this radius of the node. A last number is the
        largest angle in degrees, 45 by default, between the facets of the patch and the one there;
        the patch ends where the surface turns by more.
    x, y, z : float, str or None
        Condition on a coordinate in m: a number (equality), a comparison such as ``"> 0"`` or
        ``"<= 2"``, several such as ``"> 0 and <= 2"``, or none.
    """

    group: str | None = Field(None, exclude_if=absent)
    nodes: NodeNumbers | None = Field(None, exclude_if=absent)
    nodes_from: Literal[0, 1] | None = Field(None, exclude_if=absent)
    boundary: bool = Field(False, exclude_if=lambda boundary: not boundary)
    sphere: tuple[float, ...] | None = Field(None, min_length=3, max_length=4, exclude_if=absent)
    plane: tuple[float, ...] | None = Field(None, min_length=4, max_length=6, exclude_if=absent)
    patch: tuple[float, ...] | None = Field(None, min_length=3, max_length=5, exclude_if=absent)
    x: float | str | None = None
    y: float | str | None = None
    z: float | str | None = None

    @field_validator("nodes", mode="before", json_schema_input_type=NodeNumbers | str | None)
    @classmethod
    def _are_read(cls, value: Any, info: ValidationInfo) -> Any:
        """Read a file of numbers; the context is the folder of a case file."""
        if isinstance(value, str) and isinstance(info.context, Path):
            value = read_node_list(info.context / value)
        if isinstance(value, tuple) and all(isinstance(number, int) for number in value):
            require_different(value)
        return value

    @model_validator(mode="after")
    def _says_the_first_number(self) -> Region:
        if (self.nodes is None) != (self.nodes_from is None):
            raise ValueError(
                "expected 'nodes', and 'nodes_from' = 0 or 1, the number of the first node of the "
                "mesh, both or neither"
            )
        return self

    @field_validator("x", "y", "z")
    @classmethod
    def _is_condition(cls, value: float | str | None) -> float | str | None:
        if isinstance(value, str):
            parse_conditions(value)
        return value

    @field_validator("sphere")
    @classmethod
    def _has_radius(cls, value: tuple[float, ...] | None) -> tuple[float, ...] | None:
        if value is not None and not (np.isfinite(value).all() and value[-1] > 0):
            raise ValueError("expected the coordinates of a centre and a positive radius, in m")
        return value

    @field_validator("plane", "patch")
    @classmethod
    def _is_finite(cls, value: tuple[float, ...] | None) -> tuple[float, ...] | None:
        if value is not None and not np.isfinite(value).all():
            raise ValueError("expected finite numbers")
        return value

    def select(
        self,
        coordinates: NDArray[np.float64],
        groups: Mapping[str, NDArray[np.int64]] = MappingProxyType({}),
        facets: NDArray[np.int64] | None = None,
        places: NDArray[np.int64] | None = None,
        origins: NDArray[np.int64] | None = None,
        counted_from: tuple[int, ...] = (0, 1),
    ) -> NDArray[np.bool_]:
        """Select the nodes of the region.

        Parameters
        ----------
        coordinates : array, (n_nodes, d)
            Node coordinates in m.
        groups : mapping of str to array of int
            Node numbers of every named group of the mesh.
        facets : array of int, (n_facets, n_corners), optional
            Node numbers of every facet of the surface; `boundary` and `origins` need them.
        places : array of int, (n_nodes,), optional
            Number of every node in the file of the mesh, counted from 0; all nodes in turn by
            default.
        origins : array of int, (n_nodes, n_corners), optional
            Nodes of the file that each node of a refined mesh comes from.
        counted_from : tuple of int
            Numbers that the first node of the file can have.

        Returns
        -------
        array of bool, (n_nodes,)
            True for nodes in the region.

        Raises
        ------
        ValueError
            If the mesh has no such group or node, its numbers of nodes are not known or are
            counted otherwise, or `boundary` has no facets to look at.
        """
        tolerance = RELATIVE_TOLERANCE * float(np.ptp(coordinates, axis=0).max())
        inside = np.ones(len(coordinates), dtype=bool)
        if self.group is not None:
            if self.group not in groups:
                raise ValueError(missing_group(self.group, groups))
            inside[:] = False
            inside[groups[self.group]] = True
        if self.nodes is not None:
            assert self.nodes_from is not None
            if not counted_from:
                raise ValueError(
                    "nodes: the numbers of nodes in a file of this format are not read, expected a "
                    "group or conditions on coordinates"
                )
            if self.nodes_from not in counted_from:
                raise ValueError(
                    f"nodes_from = {self.nodes_from}: the file of the mesh numbers its nodes with "
                    f"gaps or out of order, expected {counted_from[0]}, and numbers as they stand "
                    "there"
                )
            places = np.arange(len(coordinates)) if places is None else places
            listed = np.zeros(len(places), dtype=bool)
            listed[numbered_nodes(self.nodes, self.nodes_from, places)] = True
            if origins is not None:
                listed = members_of(listed, origins, _on_surface(facets, len(coordinates)))
            inside &= listed
        if self.boundary:
            inside &= _on_surface(facets, len(coordinates))
        if self.sphere is not None:
            *centre, radius = self.sphere
            if len(centre) != coordinates.shape[1]:
                raise ValueError(
                    f"sphere: {len(self.sphere)} numbers, expected those of a centre in "
                    f"{coordinates.shape[1]} dimensions, and a radius"
                )
            inside &= np.linalg.norm(coordinates - centre, axis=1) <= radius + tolerance
        if self.plane is not None:
            inside &= behind(coordinates, self.plane, tolerance)
        if self.patch is not None:
            inside &= patch_around(coordinates, facets, self.patch, tolerance)
        for axis, name in enumerate(AXES[: coordinates.shape[1]]):
            condition = getattr(self, name)
            if condition is None:
                continue
            values = coordinates[:, axis]
            if isinstance(condition, str):
                for symbol, bound in parse_conditions(condition):
                    margin = tolerance if symbol in (">", "<=") else -tolerance
                    inside &= COMPARISONS[symbol](values, bound + margin)
            else:
                inside &= np.abs(values - condition) <= tolerance
        return inside


def members_of(
    members: NDArray[np.bool_], origins: NDArray[np.int64], on_surface: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    """Nodes of a refined mesh that belong to a set of coarse nodes.

    These are the coarse nodes themselves, and the new nodes of the edges, faces and cells all of
    whose corners belong; if all these are on the surface, then so is the new node.

    Parameters
    ----------
    members : array of bool, (n_coarse,)
    origins : array of int, (n_nodes, n_corners)
        Coarse nodes of the edge, face or cell that each node lies in; repeated ones fill a row.
    on_surface : array of bool, (n_nodes,)

    Returns
    -------
    array of bool, (n_nodes,)
    """
    beside = on_surface[: len(members)][origins].all(axis=1)
    return np.asarray(members[origins].all(axis=1) & (on_surface | ~beside))


def behind(
    coordinates: NDArray[np.float64], plane: Sequence[float], tolerance: float
) -> NDArray[np.bool_]:
    """Nodes on a plane or line, a point and a normal, or behind it: (n_nodes,)."""
    d = coordinates.shape[1]
    normal = np.array(plane[d:])
    if len(plane) != 2 * d or not normal.any():
        raise ValueError(
            f"plane: {len(plane)} numbers, expected {2 * d}, those of a point and a normal"
        )
    return np.asarray((coordinates - plane[:d]) @ normal <= tolerance * np.linalg.norm(normal))


def patch_around(
    coordinates: NDArray[np.float64],
    facets: NDArray[np.int64] | None,
    patch: Sequence[float],
    tolerance: float,
) -> NDArray[np.bool_]:
    """Nodes of the part of the surface around a position: (n_nodes,).

    Parameters
    ----------
    coordinates : array, (n_nodes, d)
    facets : array of int, (n_facets, n_corners)
    patch : sequence of d + 1 or d + 2 floats
        Position and radius in m, angle in degrees.
    tolerance : float
        In m.
    """
    d, on_surface = coordinates.shape[1], _on_surface(facets, len(coordinates))
    assert facets is not None
    *numbers, angle = patch if len(patch) == d + 2 else (*patch, ANGLE)
    if len(numbers) != d + 1 or not numbers[d] > 0 or not 0 < angle <= 90:
        raise ValueError(
            f"patch: {len(patch)} numbers, expected those of a position in {d} dimensions, a "
            "positive radius and, if given, an angle of 90 degrees at most"
        )
    at, nodes = np.array(numbers[:d]), np.flatnonzero(on_surface)
    middle = nodes[np.linalg.norm(coordinates[nodes] - at, axis=1).argmin()]
    corners = coordinates[facets]
    sides = corners[:, 1:] - corners[:, :1]
    normals = np.cross(sides[:, 0], sides[:, 1]) if d == 3 else sides[:, 0] @ [[0, -1], [1, 0]]
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    of_middle = np.flatnonzero((facets == middle).any(axis=1))
    centres = corners[of_middle].mean(axis=1)
    first = of_middle[np.linalg.norm(centres - at, axis=1).argmin()]
    near = np.linalg.norm(coordinates - coordinates[middle], axis=1) <= numbers[d] + tolerance
    alike = abs(normals @ normals[first]) >= np.cos(np.radians(angle)) - RELATIVE_TOLERANCE
    members = np.zeros(len(coordinates), dtype=bool)
    members[middle] = True
    rows = facets[alike & near[facets].any(axis=1)]
    while True:  # facets that share a node that is near with those found
        touched = (members & near)[rows].any(axis=1)
        if (members[rows[touched]]).all():
            return members & near
        members[rows[touched]] = True


def _on_surface(facets: NDArray[np.int64] | None, nodes: int) -> NDArray[np.bool_]:
    if facets is None:
        raise ValueError("boundary: the facets of the surface are not known")
    found = np.zeros(nodes, dtype=bool)
    found[facets] = True
    return found


def parse_conditions(text: str) -> list[tuple[str, float]]:
    """Split ``"> 0.5 and < 1"`` into comparisons and bounds; ValueError if it has another form."""
    found = []
    try:
        for part in text.split(" and "):
            match = CONDITION.match(part)
            if match is None or not math.isfinite(bound := float(match[2])):
                raise ValueError
            found.append((match[1], bound))
    except ValueError:
        raise ValueError(
            "expected a number, or a comparison such as '> 0' or '> 0 and <= 2'"
        ) from None
    return found


def read_node_list(path: Path) -> tuple[int, ...]:
    """Read whole numbers that blanks, line ends or commas separate; comments begin with ``#``.

    Raises
    ------
    ValueError
        If there is no such file, or something else stands in it.
    """
    if not path.is_file():
        raise ValueError(f"no such file {path}")
    if path.stat().st_size > LARGEST_FILE:
        raise ValueError(f"{path} has more than {LARGEST_FILE // 10**6} MB")
    lines = path.read_text(errors="replace").splitlines()
    words = [word for line in lines for word in line.partition("#")[0].replace(",", " ").split()]
    for word in words:
        if not (word.isascii() and word.isdigit() and len(word) < 19):
            raise ValueError(f"'{word[:20]}' in {path}, expected whole numbers of nodes")
    return tuple(map(int, words))


def require_different(numbers: tuple[int, ...]) -> None:
    """Raise ValueError if there is no number, or one stands there twice."""
    if not numbers:
        raise ValueError("expected one node at least")
    values, counts = np.unique(numbers, return_counts=True)
    if (counts > 1).any():
        raise ValueError(f"node {values[counts.argmax()]} stands there twice")


def numbered_nodes(
    numbers: tuple[int, ...], first: int, places: NDArray[np.int64]
) -> NDArray[np.int64]:
    """Find the nodes of a mesh by their numbers in its file.

    Parameters
    ----------
    numbers : tuple of int
    first : int
        Number of the first node of the file, 0 or 1.
    places : array of int, (n_nodes,)
        Place of every node in the file from 0, ascending: nodes of no cell are left out.

    Raises
    ------
    ValueError
        If the file has no such node, or it belongs to no cell.
    """
    wanted = np.array(numbers, dtype=np.int64) - first
    found = np.searchsorted(places, wanted).clip(max=len(places) - 1)
    missing = places[found] != wanted
    if missing.any():
        number, last = int(wanted[missing][0]) + first, int(places[-1]) + first
        within = first <= number <= last
        said = "belongs to no cell" if within else f"expected {first} to {last}"
        raise ValueError(f"node {number}: {said}")
    return found
