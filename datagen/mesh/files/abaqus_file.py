"""Meshes of Abaqus and CalculiX (``.inp``): nodes, elements and their sets, parts and instances.

Sets of an instance keep their name, with that of the instance before it (``PLATE-2.wall``) if there
are several. What makes nodes or elements by a rule, ties nodes to others, or stands in another file
is refused. An empty coordinate is 0. Format: *Abaqus Keywords Reference Guide*.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from datagen.mesh.groups import Group
from datagen.mesh.raw_mesh import raw_mesh
from shared_schema.common.bodies.groups import RawMesh

SUFFIX = ".inp"
SOLID = {4: "tetra", 5: "pyramid", 6: "wedge", 8: "hexahedron", 10: "tetra10", 15: "wedge15"}
SOLID |= {20: "hexahedron20"}
PLANE = {3: "triangle", 4: "quad", 6: "triangle6", 8: "quad8"}
LINE = {2: "line", 3: "line3"}
TYPES = (  # of elements: the beginning of their names up to the number of nodes, and their shapes
    (re.compile(r"C3D(\d+)"), SOLID),
    (re.compile(r"(?:CPE|CPS|CPEG|S|STRI|M3D|R3D|SFM3D)(\d+)"), PLANE),
    (re.compile(r"(?:T2D|T3D|R2D)(\d+)"), LINE),
)
MAKERS = ("NGEN", "NFILL", "NMAP", "NCOPY", "ELGEN", "ELCOPY", "SYSTEM", "INCLUDE", "IMPORT")
TIES = ("TIE", "EQUATION", "MPC", "RIGID BODY", "COUPLING", "EMBEDDED ELEMENT")
Numbers = tuple[int, ...]
Sets = dict[str, Numbers]
T = TypeVar("T")


@dataclass
class _Part:
    """Nodes, elements and sets of a part, or of a file without parts, by their numbers."""

    nodes: dict[int, list[float]] = field(default_factory=dict)
    elements: dict[int, tuple[str, Numbers]] = field(default_factory=dict)  # shape and nodes
    node_sets: Sets = field(default_factory=dict)
    element_sets: Sets = field(default_factory=dict)


@dataclass
class _Instance:
    """A part in the assembly, with sets of its own: moved by `shift`, then turned about `pivot`."""

    part: _Part
    shift: NDArray[np.float64] = field(default_factory=lambda: np.zeros(3))
    pivot: NDArray[np.float64] = field(default_factory=lambda: np.zeros(3))
    turn: Rotation = field(default_factory=Rotation.identity)
    node_sets: Sets = field(default_factory=dict)
    element_sets: Sets = field(default_factory=dict)

    def positions(self) -> NDArray[np.float64]:
        """Nodes in the assembly, (n_nodes, 3)."""
        rows = [(*x, 0.0, 0.0)[:3] for x in self.part.nodes.values()]
        at = np.array(rows, dtype=np.float64).reshape(-1, 3) + self.shift
        return np.asarray(self.turn.apply(at - self.pivot) + self.pivot)


@dataclass
class _Keyword:
    """A keyword with its options and data lines."""

    line: int
    name: str
    options: dict[str, str]
    data: list[list[str]] = field(default_factory=list)

    def numbers(self) -> list[float]:
        """All numbers of the data lines."""
        return [_number(word) for row in self.data for word in row if word]

    def given(self, option: str) -> str:
        """Value of an option that must stand there."""
        if not self.options.get(option):
            raise ValueError(f"*{self.name}: expected '{option}='")
        return self.options[option]


def is_of_abaqus(path: Path | str) -> bool:
    """True if a file name ends as that of an Abaqus input file."""
    return Path(path).suffix.lower() == SUFFIX


def mesh_of_abaqus(path: Path) -> RawMesh:
    """Read the mesh of an Abaqus input file.

    Raises
    ------
    ValueError
        If the file holds what is not read, with the number of its line, or the mesh is unfit.
    """
    model, text = _Model(), path.read_text(errors="replace")
    if "written by meshio" in text:  # which names plane quadrilaterals so
        text = re.sub(r"TYPE=CAX(\d)\w*", r"TYPE=CPE\1", text)
    for keyword in _keywords(text):
        try:
            model.take(keyword)
        except (ValueError, KeyError, IndexError) as error:
            raise ValueError(f"line {keyword.line}: {error}") from None
    return model.mesh()


def _keywords(text: str) -> Iterator[_Keyword]:
    """Keywords with what belongs to them, comments left out."""
    found, going_on = None, False
    for number, line in enumerate(text.splitlines(), 1):
        line = line.strip()
        if not line or line.startswith("**"):
            continue
        words = [word.strip() for word in line.split(",")]
        if line.startswith("*"):
            if found is not None:
                yield found
            found = _Keyword(number, " ".join(words.pop(0)[1:].upper().split()), {})
        if line.startswith("*") or going_on:
            assert found is not None
            pairs = [word.partition("=") for word in words if word]
            found.options |= {key.strip().upper(): value.strip() for key, _, value in pairs}
            going_on = line.endswith(",")
        elif found is not None:
            found.data.append(words)
    if found is not None:
        yield found


class _Model:
    """What has been read of a file so far."""

    def __init__(self) -> None:
        self.parts: dict[str, _Part] = {}
        self.instances: dict[str, _Instance] = {}
        self.current = self.whole = _Part()  # where nodes and elements are taken
        self.instance: _Instance | None = None
        self.in_assembly = False

    def take(self, keyword: _Keyword) -> None:
        """Take one keyword; those that say nothing about the mesh are passed over."""
        if keyword.name in MAKERS:
            raise ValueError(
                f"*{keyword.name} is not read, expected all nodes and elements in this file"
            )
        if keyword.name in TIES:
            raise ValueError(f"*{keyword.name} is not read, expected parts that share their nodes")
        match keyword.name:
            case "PART":
                self.current = self.parts[keyword.given("NAME").upper()] = _Part()
            case "END PART":
                self.current = self.whole
            case "ASSEMBLY" | "END ASSEMBLY":
                self.in_assembly = keyword.name == "ASSEMBLY"
            case "INSTANCE":
                self.instance = self._placed(keyword)
                self.instances[keyword.given("NAME")] = self.instance
            case "END INSTANCE":
                self.instance = None
            case "NODE" if not self.in_assembly:  # those of an assembly belong to no cell
                self._take_nodes(keyword)
            case "ELEMENT":
                self._take_elements(keyword)
            case "NSET" | "ELSET":
                self._take_set(keyword)

    def _placed(self, keyword: _Keyword) -> _Instance:
        part = self.parts.get(keyword.given("PART").upper())
        if part is None:
            raise ValueError(
                f"*INSTANCE of the part '{keyword.options['PART']}', which is not here"
            )
        numbers = np.array([*keyword.numbers(), *(0.0,) * 10][:10])
        shift, first, second, angle = numbers[:3], numbers[3:6], numbers[6:9], numbers[9]
        if angle == 0:
            return _Instance(part, shift)
        axis = (second - first) / np.linalg.norm(second - first)
        return _Instance(part, shift, first, Rotation.from_rotvec(np.radians(angle) * axis))

    def _take_nodes(self, keyword: _Keyword) -> None:
        _require_in_this_file(keyword)
        if keyword.options.get("SYSTEM", "R").upper() != "R":
            raise ValueError("*NODE in cylindrical or spherical coordinates, expected x, y, z")
        for row in keyword.data:
            number = int(row[0])
            if number in self.current.nodes:
                raise ValueError(f"node {number} stands there twice, expected once")
            self.current.nodes[number] = [_number(word or "0") for word in row[1:4]]
        if "NSET" in keyword.options:
            members = tuple(int(row[0]) for row in keyword.data)
            _add(self.current.node_sets, keyword.options["NSET"], members)

    def _take_elements(self, keyword: _Keyword) -> None:
        _require_in_this_file(keyword)
        if self.in_assembly:
            raise ValueError("*ELEMENT of an assembly, expected elements of its parts")
        kind = keyword.given("TYPE").upper()
        shape, count = _shape(kind)
        words = [int(word) for row in keyword.data for word in row if word]
        if len(words) % (count + 1):
            raise ValueError(f"{len(words)} numbers, expected {count + 1} for every {kind}")
        for start in range(0, len(words), count + 1):
            number, *nodes = words[start : start + count + 1]
            if number in self.current.elements:
                raise ValueError(f"element {number} stands there twice, expected once")
            self.current.elements[number] = shape, tuple(nodes)
        if "ELSET" in keyword.options:
            _add(self.current.element_sets, keyword.options["ELSET"], words[:: count + 1])

    def _take_set(self, keyword: _Keyword) -> None:
        _require_in_this_file(keyword)
        owner: _Part | _Instance = self.instance or self.current
        if self.in_assembly and "INSTANCE" in keyword.options:
            owner = _found(self.instances, keyword.options["INSTANCE"], "instance")
        elif self.in_assembly and self.instance is None:
            return  # of nodes of the assembly itself
        part = owner.part if isinstance(owner, _Instance) else owner
        known = owner.node_sets if keyword.name == "NSET" else owner.element_sets
        members: list[int] = []
        if keyword.name == "NSET" and "ELSET" in keyword.options:
            chosen = _found(owner.element_sets, keyword.options["ELSET"], "set")
            members += [node for element in chosen for node in part.elements[element][1]]
        for row in keyword.data:
            words = [word for word in row if word]
            if "GENERATE" in keyword.options:
                first, last, *step = map(int, words)
                members += range(first, last + 1, *step)
                continue
            for word in words:
                members += [int(word)] if word.isdigit() else _found(known, word, "set")
        _add(known, keyword.given(keyword.name), members)

    def mesh(self) -> RawMesh:
        """Join the instances; a file without them is one."""
        instances = self.instances or {"": _Instance(self.whole)}
        blocks: list[tuple[str, NDArray[np.int64]]] = []
        points, cell_sets, groups, start = [], dict[str, dict[int, Any]](), dict[Group, Any](), 0
        for name, each in instances.items():
            place = {number: start + n for n, number in enumerate(each.part.nodes)}
            prefix = f"{name}." if len(instances) > 1 else ""
            for group, members in {**each.part.node_sets, **each.node_sets}.items():
                groups[0, prefix + group] = _places(members, place, f"node set '{group}'")
            element_sets = {**each.part.element_sets, **each.element_sets}
            shapes = {shape for shape, _ in each.part.elements.values()}
            for shape in sorted(shapes):
                of_shape = {n: c for n, (s, c) in each.part.elements.items() if s == shape}
                cells = [_places(c, place, f"element {n}") for n, c in of_shape.items()]
                at = {number: n for n, number in enumerate(of_shape)}
                for group, members in element_sets.items():
                    chosen = np.array([at[m] for m in members if m in at], dtype=np.int64)
                    cell_sets.setdefault(prefix + group, {})[len(blocks)] = chosen
                blocks.append((shape, np.array(cells)))
            points.append(each.positions())
            start += len(place)
        whole = next(iter(instances.values())).part
        labels = np.array(list(whole.nodes), dtype=np.int64) if len(instances) == 1 else None
        listed = {g: [sets.get(n) for n in range(len(blocks))] for g, sets in cell_sets.items()}
        return raw_mesh(
            np.concatenate(points), blocks, groups, listed, labels, is_numbered=labels is not None
        )


def _shape(kind: str) -> tuple[str, int]:
    """Name that meshio gives a type of elements, and its number of nodes."""
    for begins, shapes in TYPES:
        match = begins.match(kind)
        if match is not None and int(match[1]) in shapes:
            return shapes[int(match[1])], int(match[1])
    if re.match(r"B[23]1", kind):
        return "line", 2
    if kind.startswith("CAX"):
        raise ValueError(
            f"elements of type {kind} are of a body of revolution, expected plane strain"
        )
    raise ValueError(
        f"elements of type {kind} are not read, expected solids (C3D4, C3D8), plane ones (CPE3, "
        "CPE4, CPS3, CPS4), shells, trusses or beams"
    )


def _require_in_this_file(keyword: _Keyword) -> None:
    if "INPUT" in keyword.options:
        raise ValueError(f"*{keyword.name} of another file, expected its lines in this file")


def _add(sets: Sets, name: str, members: Any) -> None:
    """Add to a set; capital letters make no difference."""
    known = next((each for each in sets if each.upper() == name.upper()), name)
    sets[known] = (*sets.get(known, ()), *members)


def _found(known: Mapping[str, T], name: str, what: str) -> T:
    """Look a name up without regard to capital letters."""
    for each, value in known.items():
        if each.upper() == name.upper():
            return value
    raise ValueError(f"no {what} '{name}' before it")


def _places(numbers: Numbers, place: Mapping[int, int], what: str) -> NDArray[np.int64]:
    """Places of nodes by their numbers."""
    missing = [number for number in numbers if number not in place]
    if missing:
        raise ValueError(f"{what}: no node {missing[0]} in the file")
    return np.array([place[number] for number in numbers], dtype=np.int64)


def _number(word: str) -> float:
    return float(word.upper().replace("D", "E"))
