r"""Mirror images of samples: for a symmetric body they are solutions too.

If the mesh, the supports and the loadable nodes of a body are symmetric about a plane normal to
axis k, then with the reflection R, which flips component k,

.. math:: u(R f) = R u(f), \qquad (R f)_a = (1 - 2 e_k e_k^T) f_{a'}

where a' is the mirror image of node a.
"""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from shared_schema.common.errors import InputError
from shared_schema.points_in_cells import PointTree
from surrogate.learning.data.samples import Samples
from surrogate.mechanics.body.geometry import Geometry

AXES = ("x", "y", "z")
TOLERANCE = 1e-6  # of mirrored positions, relative to the body's size


def mirror_images(geometry: Geometry, axis: str, key: str) -> NDArray[np.int64]:
    """Return the mirror image of every node about the plane through the body's middle.

    Parameters
    ----------
    geometry : Geometry
    axis : {"x", "y", "z"}
        Axis normal to the plane.
    key : str
        Configuration key that asks for it, for error messages.

    Returns
    -------
    array of int, (n_nodes,)

    Raises
    ------
    InputError
        If nodes, cells, materials, supports or loadable nodes are not symmetric.
    """
    wrong = f"{key} = '{axis}': the body is not symmetric about its middle,"
    if axis not in AXES[: geometry.dimension]:
        raise InputError(f"{key} = '{axis}': expected one of {AXES[: geometry.dimension]}")
    k, x = AXES.index(axis), geometry.coordinates
    mirrored = x.copy()
    mirrored[:, k] = x[:, k].min() + x[:, k].max() - x[:, k]
    distance, image = PointTree(x).query(mirrored)
    if distance.max() > TOLERANCE * np.ptp(x, axis=0).max():
        worst = ", ".join(f"{value:.4g}" for value in x[distance.argmax()])
        raise InputError(f"{wrong} the node at ({worst}) has no mirror image")
    cells = np.sort(geometry.cells, axis=1)
    images = np.sort(image[geometry.cells], axis=1)
    if not np.array_equal(np.unique(cells, axis=0), np.unique(images, axis=0)):
        raise InputError(f"{wrong} its cells are not mirror images of each other")
    if geometry.parts is not None:
        one, other = np.lexsort(cells.T), np.lexsort(images.T)
        if not np.array_equal(geometry.parts[one], geometry.parts[other]):
            raise InputError(f"{wrong} its materials are not")
    for name, marked in (("supports", geometry.held), ("loadable nodes", geometry.loadable)):
        if not np.array_equal(marked, marked[image]):
            raise InputError(f"{wrong} its {name} are not")
    return np.asarray(image)


def with_mirror_images(
    samples: Samples, geometry: Geometry, axes: tuple[str, ...], key: str
) -> Samples:
    """Add the mirror images of samples: about each plane, of all samples so far.

    Parameters
    ----------
    samples : Samples
        On a grid whose points are nodes.
    geometry : Geometry
    axes : tuple of {"x", "y", "z"}
        Axes normal to the planes; n axes make 2ⁿ times as many samples.
    key : str
        Configuration key that asks for them, for error messages.

    Raises
    ------
    InputError
        If the body is not symmetric, or its grid is embedded.
    """
    if axes and not geometry.grid.points_are_nodes:
        raise InputError(
            f"{key} = {list(axes)}: the dataset's grid is embedded on its mesh, expected one whose "
            "points are nodes"
        )
    both = [samples.force, samples.displacement]
    for axis in axes:
        image = mirror_images(geometry, axis, key)
        both = [_with_images(field, geometry, image, AXES.index(axis)) for field in both]
    return Samples(*both)


def _with_images(field: Tensor, geometry: Geometry, image: NDArray[np.int64], axis: int) -> Tensor:
    """Join a field (N, d, nx, ny[, nz]) and its mirror image."""
    grid = geometry.grid
    places = np.flatnonzero(grid.mask)  # of the nodes, in the flattened grid
    nodes = grid.node_at.ravel()[places]
    place_of = np.empty(len(image), dtype=np.int64)
    place_of[nodes] = places
    source = np.arange(grid.mask.size)
    source[places] = place_of[image[nodes]]
    sign = torch.ones(geometry.dimension, 1)
    sign[axis] = -1
    mirrored = field.flatten(2).index_select(2, torch.from_numpy(source)) * sign
    return torch.cat([field, mirrored.reshape(field.shape)])
