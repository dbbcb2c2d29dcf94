"""gmsh meshes of format 2, as text or binary.

An element in several physical groups stands there once for each, under another number. gmsh reads
the groups of whole entities instead, and drops elements whose number stands there twice; so these
files are read here. Format: gmsh's manual, *MSH file format version 2*.
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from datagen.mesh.groups import dimension_of
from datagen.mesh.raw_mesh import raw_mesh, require_different
from shared_schema.common.bodies.groups import RawMesh

Ints = NDArray[np.int64]
FORMAT = re.compile(rb"\$MeshFormat\s+2(?:\.\d+)?\s+([01])\s+8[^\n]*\n")
NAMED = re.compile(r'^\s*(\d)\s+(\d+)\s+"(.*)"\s*$', re.MULTILINE)
TYPES = {  # of elements: meshio's name and number of nodes
    **{15: ("vertex", 1), 1: ("line", 2), 2: ("triangle", 3), 3: ("quad", 4), 4: ("tetra", 4)},
    **{5: ("hexahedron", 8), 6: ("wedge", 6), 7: ("pyramid", 5), 8: ("line3", 3)},
    **{9: ("triangle6", 6), 10: ("quad9", 9), 11: ("tetra10", 10), 12: ("hexahedron27", 27)},
    **{16: ("quad8", 8), 17: ("hexahedron20", 20)},
}
Elements = dict[int, Ints]  # by type: number, physical group and nodes, (n_elements, 2 + n_nodes)


def is_msh2(content: bytes) -> bool:
    """True for the content of a gmsh mesh of format 2."""
    return FORMAT.search(content) is not None


def mesh_of_msh2(content: bytes) -> RawMesh:
    """Read a gmsh mesh of format 2.

    If cells of the highest dimension are in physical groups, the mesh consists of these.

    Raises
    ------
    ValueError
        If it is damaged, two nodes or elements have one number, or the mesh is unfit.
    """
    found = FORMAT.search(content)
    read = _read_binary if found is not None and found[1] == b"1" else _read_text
    try:
        labels, points, elements = read(content)
    except (IndexError, KeyError, OverflowError, ValueError) as error:
        raise ValueError(
            f"the gmsh mesh cannot be read ({error}), expected one of format 2 with the types of "
            "elements of first and second order"
        ) from None
    numbers = [rows[:, 0] for rows in elements.values()]
    require_different("element", np.concatenate([np.empty(0, np.int64), *numbers]))
    names = {
        (int(dimension), int(tag)): name
        for dimension, tag, name in NAMED.findall(_section(content, b"PhysicalNames").decode())
    }
    highest = max((dimension_of(TYPES[kind][0]) for kind in elements), default=0)
    has_bodies = any(
        rows[:, 1].any() and dimension_of(TYPES[kind][0]) == highest
        for kind, rows in elements.items()
    )
    blocks, members = [], []
    for kind, rows in elements.items():
        name, dimension = TYPES[kind][0], dimension_of(TYPES[kind][0])
        kept = rows[rows[:, 1] > 0] if has_bodies and dimension == highest else rows
        cells, number = _each_once(kept)
        blocks.append((name, _places_of(cells, labels)))
        tags = np.unique(kept[kept[:, 1] > 0, 1]).tolist()
        members.append({names.get((dimension, t), str(t)): number[kept[:, 1] == t] for t in tags})
    every = {name for groups in members for name in groups}
    cell_sets = {name: [groups.get(name) for groups in members] for name in sorted(every)}
    return raw_mesh(points, blocks, {}, cell_sets, labels)


def _each_once(rows: Ints) -> tuple[Ints, Ints]:
    """Cells of some elements, each once in the order of the file, and the cell of every element."""
    ordered = np.sort(rows[:, 2:], axis=1)
    _, first, number = np.unique(ordered, axis=0, return_index=True, return_inverse=True)
    pairs = np.column_stack([number.ravel(), rows[:, 1]])
    _, pair, count = np.unique(pairs, axis=0, return_inverse=True, return_counts=True)
    again = count[pair.ravel()] > 1
    if again.any():
        same = rows[(pairs == pairs[again.argmax()]).all(axis=1), 0]
        raise ValueError(
            f"elements {', '.join(map(str, same[:6]))}: the same nodes, expected each cell once"
        )
    order = np.argsort(first)
    rank = np.empty(len(order), dtype=np.int64)
    rank[order] = np.arange(len(order))
    return rows[first[order], 2:], rank[number.ravel()]


def _places_of(cells: Ints, labels: Ints) -> Ints:
    """Places of nodes in the file by their numbers."""
    order = np.argsort(labels)
    at = np.searchsorted(labels, cells, sorter=order).clip(max=len(labels) - 1)
    places = order[at]
    missing = labels[places] != cells
    if missing.any():
        raise ValueError(f"node {cells[missing][0]} of an element is not in the file")
    return np.asarray(places, dtype=np.int64)


def _section(content: bytes, name: bytes) -> bytes:
    """What stands between ``$NAME`` and ``$EndNAME``; nothing if there is no such section."""
    head = re.search(rb"\$%s[ \t]*\r?\n" % name, content)
    if head is None:
        return b""
    end = content.find(b"$End" + name, head.end())
    return content[head.end() : end if end >= 0 else None]


def _read_text(content: bytes) -> tuple[Ints, NDArray[np.float64], Elements]:
    """Numbers and positions of nodes, and elements."""
    count, *words = _section(content, b"Nodes").split()
    table = np.array(words, dtype=np.float64).reshape(int(count), 4)
    count, *lines = _section(content, b"Elements").splitlines()
    found = defaultdict[int, list[list[int]]](list)
    for line in lines:
        if line.strip():
            number, kind, tags, *rest = map(int, line.split())
            nodes = rest[tags:]
            if len(nodes) != TYPES[kind][1]:
                raise ValueError(f"element {number} has {len(nodes)} nodes")
            found[kind].append([number, rest[0] if tags else 0, *nodes])
    elements = {kind: np.array(rows, dtype=np.int64) for kind, rows in found.items()}
    _require_count(elements, int(count))
    return table[:, 0].astype(np.int64), table[:, 1:], elements


def _read_binary(content: bytes) -> tuple[Ints, NDArray[np.float64], Elements]:
    """As `_read_text`; counts stand in the file, so no byte of the data is taken for an end."""
    start = FORMAT.search(content)
    if start is None or content[start.end() : start.end() + 4] != b"\1\0\0\0":
        raise ValueError("binary numbers begin with the highest byte")
    at = content.index(b"$Nodes\n", start.end()) + 7
    text, at = _line(content, at)
    of_node = np.dtype([("number", "<i4"), ("position", "<f8", 3)])
    table = np.frombuffer(content, of_node, int(text), at)
    at = content.index(b"$Elements\n", at + table.nbytes) + 10
    text, at = _line(content, at)
    found = defaultdict[int, list[Ints]](list)
    for kind, tags, rows in _element_blocks(content, at, int(text)):
        group = rows[:, 1:2] if tags else np.zeros((len(rows), 1))
        found[kind].append(np.hstack([rows[:, :1], group, rows[:, 1 + tags :]]).astype(np.int64))
    elements = {kind: np.concatenate(blocks) for kind, blocks in found.items()}
    return table["number"].astype(np.int64), table["position"].astype(np.float64), elements


def _element_blocks(content: bytes, at: int, count: int) -> Iterator[tuple[int, int, Any]]:
    """Type, number of tags, and the numbers of every block of a binary file."""
    while count > 0:
        kind, some, tags = np.frombuffer(content, "<i4", 3, at).tolist()
        width = 1 + tags + TYPES[kind][1]
        if some <= 0:
            raise ValueError("a block of no elements")
        yield kind, tags, np.frombuffer(content, "<i4", some * width, at + 12).reshape(-1, width)
        at, count = at + 12 + 4 * some * width, count - some


def _line(content: bytes, at: int) -> tuple[bytes, int]:
    """A line, and where the next one begins."""
    end = content.index(b"\n", at)
    return content[at:end], end + 1


def _require_count(elements: Elements, count: int) -> None:
    found = sum(map(len, elements.values()))
    if found != count:
        raise ValueError(f"{found} elements, of {count} that it says it has")
