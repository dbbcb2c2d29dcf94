"""Forces on all nodes of a mesh from the forces on its loaded nodes; forces on one node add up."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray


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
