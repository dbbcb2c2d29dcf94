"""Forces at nodes, also in the notation of the command line: ``"X,Y[,Z]:FX,FY[,FZ]"``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shared_schema.common.errors import InputError


def scatter_forces(
    loaded_nodes: NDArray[np.int64], forces: NDArray[Any], n_nodes: int
) -> NDArray[np.float64]:
    """Add the forces on loaded nodes into forces on all nodes.

    Parameters
    ----------
    loaded_nodes : array of int, (..., n_loads)
        Node numbers; negative ones are padding.
    forces : array, (..., n_loads, d)
        Force vector at each loaded node, in N.
    n_nodes : int

    Returns
    -------
    array, (..., n_nodes, d)
        In N; the sum of the forces where a node occurs more than once, 0 where it does not occur.
    """
    total = np.zeros((*forces.shape[:-2], n_nodes, forces.shape[-1]))
    place = np.nonzero(loaded_nodes >= 0)
    np.add.at(total, (*place[:-1], loaded_nodes[place]), forces[place])
    return total


def sum_per_node(
    loaded_nodes: NDArray[np.int64], forces: NDArray[np.float64]
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Sum the forces of one load case node by node, so that each node occurs once.

    Parameters
    ----------
    loaded_nodes : array of int, (n_loads,)
        Node numbers.
    forces : array, (n_loads, d)
        In N.

    Returns
    -------
    nodes : array of int, (n_distinct,)
        In the order of their first occurrence.
    forces : array, (n_distinct, d)
        In N.
    """
    numbers, first, position = np.unique(loaded_nodes, return_index=True, return_inverse=True)
    if len(numbers) == len(loaded_nodes):
        return loaded_nodes, forces
    order = np.argsort(first)
    return numbers[order], scatter_forces(position.ravel(), forces, len(numbers))[order]


RELATIVE_TOLERANCE = 1e-4  # of the size of the mesh, for places given in four decimals
COINCIDENT = 1e-9  # of the size of the mesh: the distance of nodes that stand at one place


@dataclass(frozen=True)
class PointLoad:
    """A force vector at a point.

    Attributes
    ----------
    position : tuple of d floats
        In m.
    force : tuple of d floats
        In N.
    """

    position: tuple[float, ...]
    force: tuple[float, ...]

    @classmethod
    def parse(cls, text: str, dimension: int) -> PointLoad:
        """Read ``"X,Y[,Z]:FX,FY[,FZ]"``.

        Raises
        ------
        InputError
            If the text is not of that form, has another dimension, or holds a NaN or an infinity.
        """
        expected = "X,Y:FX,FY" if dimension == 2 else "X,Y,Z:FX,FY,FZ"
        try:
            vectors = [tuple(float(v) for v in vector.split(",")) for vector in text.split(":")]
        except ValueError:
            vectors = []
        if len(vectors) != 2 or any(len(vector) != dimension for vector in vectors):
            raise InputError(f"--load '{text}': expected {expected}, metres and newtons")
        if not np.isfinite(vectors).all():
            raise InputError(f"--load '{text}': expected finite numbers")
        return cls(*vectors)


def nodal_forces(
    loads: Sequence[str],
    coordinates: NDArray[np.float64],
    clamped: NDArray[np.bool_],
    nearest: bool = False,
    notes: list[str] | None = None,
) -> NDArray[np.float64]:
    """Turn loads in the notation of the command line into nodal forces; loads at one node add up.

    Parameters
    ----------
    loads : sequence of str
        Each ``"X,Y[,Z]:FX,FY[,FZ]"``.
    coordinates : array, (n_nodes, d)
        In m.
    clamped : array of bool, (n_nodes,)
    nearest : bool
        Load the nearest node that is not clamped, wherever it is.
    notes : list of str, optional
        A line is added for every load that was moved to another place.

    Returns
    -------
    array, (n_nodes, d)
        Force at every node, in N.

    Raises
    ------
    InputError
        If a load is malformed, stands at no node, or stands at a clamped node.
    """
    nodes: list[int] = []
    vectors: list[tuple[float, ...]] = []
    for text in loads:
        load = PointLoad.parse(text, coordinates.shape[1])
        position = np.array(load.position)
        nodes.append(node_at(position, f"--load '{text}'", coordinates, clamped, nearest, notes))
        vectors.append(load.force)
    forces = np.array(vectors).reshape(-1, coordinates.shape[1])
    return scatter_forces(np.array(nodes, dtype=np.int64), forces, len(coordinates))


def node_at(
    position: NDArray[np.float64],
    option: str,
    coordinates: NDArray[np.float64],
    clamped: NDArray[np.bool_],
    nearest: bool = False,
    notes: list[str] | None = None,
) -> int:
    """Find the node at a position, (d,) in m; the other parameters are those of `nodal_forces`.

    Raises
    ------
    InputError
        If none or several stand there, or it is clamped; the message begins with `option`.
    """
    size = float(np.ptp(coordinates, axis=0).max())
    tolerance = RELATIVE_TOLERANCE * size
    distance = np.linalg.norm(coordinates - position, axis=1)
    if nearest:
        distance[clamped] = np.inf
    node = int(distance.argmin())
    if distance[node] > tolerance:
        at = ",".join(f"{value:g}" for value in coordinates[node])
        if not nearest:
            raise InputError(f"{option}: no node stands there, the nearest is at {at} (--nearest)")
        if distance[node] > size:
            raise InputError(
                f"{option}: no node is near, the nearest is at {at}, farther than the body is long"
            )
        if notes is not None:
            notes.append(f"{option}: acts at the nearest node, {at}, {distance[node]:.3g} away")
    if clamped[node]:
        raise InputError(f"{option}: the node is clamped, expected a free one")
    here = np.linalg.norm(coordinates - coordinates[node], axis=1) <= COINCIDENT * size
    if here.sum() > 1:
        raise InputError(
            f"{option}: nodes {', '.join(map(str, np.flatnonzero(here)))} (from 0) stand there, "
            "where parts of the body are not joined: expected one, such as in a group"
        )
    return node
