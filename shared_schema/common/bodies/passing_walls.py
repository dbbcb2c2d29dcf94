r"""Walls of a cavity that pass through each other, and points inside of a closed surface.

No equation here prevents the former.

A point just in front of a wall, inside the cavity, is surrounded by the closed surface once: its
winding number, the solid angle of all facets over 4π (in the plane, the angle over 2π), is 1. If
another wall has passed through it, it is another number. The solid angle Ω of a triangle with
corners at a, b, c from the point is

.. math:: \tan \frac Ω2 = \frac{a · (b × c)}{|a||b||c| + (a · b)|c| + (b · c)|a| + (c · a)|b|}

(A. van Oosterom and J. Strackee 1983, *IEEE Trans. Biomed. Eng.* 30, 125).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
AHEAD = 1e-3  # of the size of a facet
AT_ONCE = 2_000_000  # pairs of points and triangles
TRIANGLES = {2: ((0, 1),), 3: ((0, 1, 2),), 4: ((0, 1, 2), (2, 3, 0))}  # of facets, by corners


def passing_walls(x: Array, facets: NDArray[np.int64]) -> int:
    """Count the facets of a cavity that others have passed.

    Parameters
    ----------
    x : array, (n_points, d)
        Present positions in m.
    facets : array of int, (n_facets, n_points of a facet)
        All facets of the cavity, seen from outside of the body.
    """
    simplices = _simplices(x, facets)
    if x.shape[1] == 2:
        along = simplices[:, 1] - simplices[:, 0]
        normals, size = np.stack([along[:, 1], -along[:, 0]], axis=1), 1.0
    else:
        normals = np.cross(simplices[:, 1] - simplices[:, 0], simplices[:, 2] - simplices[:, 0])
        lengths = np.linalg.norm(normals, axis=1, keepdims=True)
        size = np.sqrt(lengths) / np.maximum(lengths, np.finfo(float).tiny)
    ahead = simplices.mean(axis=1) + AHEAD * size * normals
    passed = 0
    step = max(1, AT_ONCE // len(simplices))
    for start in range(0, len(ahead), step):
        numbers = _winding(ahead[start : start + step], simplices)
        passed += int((np.abs(numbers - 1) > 0.5).sum())
    return passed


def surrounds(x: Array, facets: NDArray[np.int64], point: Array) -> bool:
    """Whether a point, (d,) in m, lies inside of a body with this surface: see `passing_walls`."""
    return bool(np.abs(_winding(point[None], _simplices(x, facets)))[0] > 0.5)


def _simplices(x: Array, facets: NDArray[np.int64]) -> Array:
    """Corners of lines, or of triangles, that facets are cut into: (n, d, d)."""
    corners = 2 if x.shape[1] == 2 else 3 if facets.shape[1] in (3, 6) else 4
    return np.concatenate([x[facets[:, some]] for some in TRIANGLES[corners]])


def _winding(points: Array, simplices: Array) -> Array:
    """Winding numbers of a surface that is seen from inside of the cavity: (n,)."""
    seen = simplices[None] - points[:, None, None]
    sizes = np.linalg.norm(seen, axis=-1)
    if points.shape[1] == 2:
        a, b = seen[:, :, 0], seen[:, :, 1]
        angles = np.arctan2(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0], (a * b).sum(-1))
        return -angles.sum(axis=1) / (2 * np.pi)
    a, b, c = seen[:, :, 0], seen[:, :, 1], seen[:, :, 2]
    volume = (a * np.cross(b, c)).sum(-1)
    below = sizes.prod(-1) + sum(
        (some * other).sum(-1) * sizes[:, :, k]
        for some, other, k in ((a, b, 2), (b, c, 0), (c, a, 1))
    )
    return -2 * np.arctan2(volume, below).sum(axis=1) / (4 * np.pi)
