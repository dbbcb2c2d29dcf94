r"""Points of quadratic elements between the nodes of a mesh, and the forces on them.

The *points* of the elements are the corners of the cells, which are the nodes of the mesh, and
points between them (`shared_schema.common.bodies.reference_cells`). Linear shape functions of a
corner a are sums of quadratic ones, with their values at the points b:

.. math:: N^1_a = \sum_b I_{ba} N^2_b, \qquad I_{ba} = N^1_a(x_b).

Consistent forces :math:`f^2_b = \int N^2_b \, t \, dS` on all points have two parts. The *forces at
the nodes* do the same work in every displacement that is linear in the cells, and are those of
linear elements; the *forces between* them, g, are those on the points between:

.. math:: f^1 = I^T f^2, \qquad g = f^2_{between}, \qquad f^2_{corners} = f^1 - I_{between}^T \, g.

With g = 0 the forces at the nodes are point forces at the corners. Resultant and moment of the load
are those of :math:`f^1` in any case.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from shared_schema.common.arguments import hold_read_only
from shared_schema.common.bodies.reference_cells import BETWEEN

Array = NDArray[np.float64]
Numbers = NDArray[np.int64]
NONE = -1  # in place of a corner: some points have fewer corners than others
FACETS = {2: "line", 3: "triangle", 4: "quad"}  # by their number of corners


@dataclass(frozen=True)
class PointsBetween:
    """Points of the quadratic elements on a mesh: the nodes first, then the points between them.

    Its arrays are read-only.

    Attributes
    ----------
    nodes : int
        Number of nodes.
    corners : array of int, (n_between, most)
        Corners whose mean each point between is, ascending and padded with -1; in lexicographic
        order.
    cells : array of int, (n_cells, n_points)
        Numbers of the points of every cell: corners as in the mesh, then those of `BETWEEN`.
    """

    nodes: int
    corners: Numbers
    cells: Numbers

    def __post_init__(self) -> None:
        hold_read_only(self)

    @classmethod
    def of(cls, cells: Numbers, cell_type: str, nodes: int) -> PointsBetween:
        """Number the points of the cells of a mesh, (n_cells, n_corners) in VTK order."""
        rows = _corners_between(cells, cell_type)
        corners, numbers = np.unique(rows.reshape(-1, rows.shape[2]), axis=0, return_inverse=True)
        points = nodes + numbers.reshape(rows.shape[:2])
        return cls(nodes, corners, np.concatenate([cells, points], axis=1))

    @property
    def between(self) -> int:
        """Number of points between the nodes."""
        return len(self.corners)

    @property
    def count(self) -> int:
        """Number of all points."""
        return self.nodes + self.between

    @cached_property
    def interpolation(self) -> csr_array:
        """I: linear shape functions of the corners at the points, (n_points, n_nodes)."""
        inside = self.corners != NONE
        sizes = inside.sum(axis=1)
        starts = np.concatenate([np.arange(self.nodes), self.nodes + np.cumsum([0, *sizes])])
        columns = np.concatenate([np.arange(self.nodes), self.corners[inside]])
        weights = np.concatenate([np.ones(self.nodes), np.repeat(1 / sizes, sizes)])
        return csr_array((weights, columns, starts), shape=(self.count, self.nodes))

    def interpolated(self, values: Array) -> Array:
        """Values at all points by those at the nodes: (…, n_nodes, k) → (…, n_points, k)."""
        return _times(self.interpolation, values)

    def held(self, components: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Components held at all corners around a point: nodes' (n_nodes, d) → (n_points, d)."""
        return np.asarray(self.interpolation @ (~components).astype(np.float64) == 0.0)

    def numbers(self, corners: Numbers) -> Numbers:
        """Find points between by their corners, (n, at most `most`): (n,), counted with the nodes.

        Raises
        ------
        ValueError
            If there is no such point.
        """
        width = self.corners.shape[1]
        padded = np.full((len(corners), width), NONE)
        padded[:, : corners.shape[1]] = np.sort(np.where(corners == NONE, self.nodes, corners))
        padded[padded == self.nodes] = NONE
        rows, numbers = np.unique(
            np.concatenate([self.corners, padded]), axis=0, return_inverse=True
        )
        if len(rows) != self.between:
            raise ValueError("no such point between the nodes of the mesh")
        return np.asarray(self.nodes + numbers.ravel()[self.between :])

    def facets(self, facets: Numbers) -> Numbers:
        """Points of facets by their corners, going round: (n_facets, n_corners) → (…, n_points)."""
        rows = _corners_between(facets, FACETS[facets.shape[1]])
        points = self.numbers(rows.reshape(-1, rows.shape[2]))
        return np.concatenate([facets, points.reshape(rows.shape[:2])], axis=1)

    def on_nodes(self, f: Array) -> Array:
        """Forces at the nodes that do the work of those on all points: :math:`f^1` of f².

        From (…, n_points, d) to (…, n_nodes, d), in N.
        """
        return _times(self.interpolation.T, f)

    def on_points(self, f: Array, between: Array) -> Array:
        """Forces on all points by those at the nodes and the forces between them: f² of f¹ and g.

        From (…, n_nodes, d) and (…, n_between, d) to (…, n_points, d), in N.
        """
        of_corners = f - _times(self.interpolation[self.nodes :].T, between)
        return np.concatenate([of_corners, between], axis=-2)


def _times(matrix: csr_array, values: Array) -> Array:
    """Product of a sparse matrix (m, n) with the last but one axis of an array: (…, m, k)."""
    rows = np.moveaxis(values, -2, 0)
    product = matrix @ rows.reshape(len(rows), -1)
    return np.moveaxis(product.reshape(len(product), *rows.shape[1:]), 0, -2)


def _corners_between(cells: Numbers, cell_type: str) -> Numbers:
    """Corners of the points between those of cells, ascending, padded: (n_cells, n, most)."""
    between = BETWEEN[cell_type]
    corners = np.full((len(cells), len(between), max(map(len, between))), NONE)
    for number, some in enumerate(between):
        corners[:, number, : len(some)] = np.sort(cells[:, some], axis=1)
    return corners
