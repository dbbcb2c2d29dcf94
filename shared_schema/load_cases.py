"""Load cases in a file of their own, which `datagen run --loads` solves.

No manifest has the checksum of such a file. So it ends with one: the SHA-256, in 64 hexadecimal
digits, of all that is before it. HDF5 does not read that far.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from shared_schema.common.errors import InputError
from shared_schema.common.files import complete_or_absent, require_plain
from shared_schema.layout import NO_NODE
from shared_schema.shard import read_shard, shard_content

Array = NDArray[np.float64]
DIGITS = 64  # of the checksum at the end


@dataclass(frozen=True)
class LoadCases:
    """Load cases on one mesh.

    Attributes
    ----------
    coordinates : array, (n_nodes, d)
        Undeformed positions of all nodes of the mesh in m.
    nodes : array of int, (n, most)
        Loaded nodes of every load case, padded with -1.
    forces : array, (n, most, d)
        Force vector at each of them in N, padded with 0.
    between : array, (n, n_between, d), optional
        Forces between the nodes in N (`shared_schema.common.bodies.points_between`).
    """

    coordinates: Array
    nodes: NDArray[np.int64]
    forces: Array
    between: Array | None = None

    def __len__(self) -> int:
        return len(self.nodes)

    @classmethod
    def of(cls, coordinates: Array, forces: Array, between: Array | None = None) -> LoadCases:
        """Make load cases from forces at all nodes, (n, n_nodes, d) in N, and between them."""
        loaded = np.any(forces, axis=2)
        most = max(1, int(np.sum(loaded, axis=1).max(initial=0)))
        nodes = np.full((len(forces), most), NO_NODE, dtype=np.int64)
        padded = np.zeros((len(forces), most, forces.shape[2]))
        for row in range(len(forces)):
            found = np.flatnonzero(forces[row].any(axis=1))
            nodes[row, : len(found)], padded[row, : len(found)] = found, forces[row, found]
        return cls(coordinates, nodes, padded, between)

    def load(self, number: int) -> tuple[NDArray[np.int64], Array]:
        """Return loaded nodes and force vectors of one load case: (n_loads,), (n_loads, d)."""
        loaded = self.nodes[number] != NO_NODE
        return self.nodes[number][loaded], self.forces[number][loaded]


def write_load_cases(path: str | Path, cases: LoadCases, cell_type: str) -> str:
    """Write a file of load cases atomically; return the SHA-256 at its end.

    The cell type is that of the mesh: "triangle", "quad", "tetra" or "hexahedron".
    """
    path = Path(path)
    arrays = {
        "mesh/coordinates": cases.coordinates,
        "loads/loaded_nodes": cases.nodes,
        "loads/force": cases.forces,
    }
    if cases.between is not None:
        arrays["loads/force_between"] = cases.between
    content = shard_content(path.name, "loads", arrays, "", cell_type)
    digest = hashlib.sha256(content).hexdigest()
    with complete_or_absent(path) as partial:
        partial.write_bytes(content + digest.encode())
    return digest


def read_load_cases(path: Path) -> LoadCases:
    """Read a file of load cases.

    Raises
    ------
    InputError
        If the file is missing, damaged or no file of load cases.
    """
    if not path.is_file():
        raise InputError(f"{path}: no such file of load cases")
    file = path.resolve()  # a user's own link is followed
    require_plain(file.parent, file)
    content = file.read_bytes()
    if hashlib.sha256(content[:-DIGITS]).hexdigest().encode() != content[-DIGITS:]:
        raise InputError(f"{path}: damaged or no file of load cases, its checksum does not match")
    arrays = read_shard(file, "loads")
    cases = LoadCases(
        arrays["mesh/coordinates"],
        arrays["loads/loaded_nodes"],
        arrays["loads/force"],
        arrays.get("loads/force_between"),
    )
    nodes = cases.nodes
    if len(cases) == 0:
        raise InputError(f"{path}: no load cases in it")
    if nodes.min() < NO_NODE or nodes.max() >= len(cases.coordinates):
        raise InputError(
            f"{path}: 'loads/loaded_nodes' names a node outside 0 … {len(cases.coordinates) - 1}"
        )
    return cases
