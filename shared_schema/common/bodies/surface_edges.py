"""Edges of the faces of a surface, and those of them at which it turns by more than 30°."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

SMOOTH = np.cos(np.radians(30))  # faces at a larger angle meet in a sharp edge


def edges_of(faces: NDArray[np.int64]) -> NDArray[np.int64]:
    """Edges of all faces, going round each of them: (n, corners) → (n · corners, 2)."""
    return np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2)


def smooth_pairs(coordinates: NDArray[np.float64], faces: NDArray[np.int64]) -> NDArray[np.int64]:
    """Find the pairs of equal edges whose two faces meet at 30° at most; in the plane, all pairs.

    Parameters
    ----------
    coordinates : array, (n_nodes, d)
        In m.
    faces : array of int, (n_faces, n_corners)
        Node numbers, in space going round each face as seen from outside.

    Returns
    -------
    array of int, (n_pairs, 2)
        Rows of `edges_of`.
    """
    around = np.sort(edges_of(faces), axis=1)
    _, number, count = np.unique(around, axis=0, return_inverse=True, return_counts=True)
    number = number.ravel()
    order: NDArray[np.int64] = np.argsort(number, kind="stable")
    order = order[count[number[order]] == 2].reshape(-1, 2)
    if coordinates.shape[1] == 2:
        return order
    x = coordinates[faces]
    normal = np.cross(x[:, 1] - x[:, 0], x[:, -1] - x[:, 0])
    normal = normal / np.linalg.norm(normal, axis=1, keepdims=True)
    of_edge = order // faces.shape[1]
    cosine = np.einsum("ij,ij->i", normal[of_edge[:, 0]], normal[of_edge[:, 1]])
    return np.asarray(order[cosine >= SMOOTH])


def sharp_edges(coordinates: NDArray[np.float64], faces: NDArray[np.int64]) -> NDArray[np.int64]:
    """Edges, each once, at which a surface turns by more than 30° or ends: (n_edges, 2)."""
    around = np.sort(edges_of(faces), axis=1)
    lines, smooth = np.unique(around, axis=0), around[smooth_pairs(coordinates, faces)[:, 0]]
    size = int(lines.max()) + 1
    return lines[~np.isin(lines @ [size, 1], smooth @ [size, 1])]
