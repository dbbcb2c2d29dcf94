"""Drawings of bodies in space: a parallel projection of the surface, hidden parts left out."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import PolyCollection
from numpy.typing import NDArray

from shared_schema.common.bodies.surface_edges import edges_of, sharp_edges
from shared_schema.common.drawing.depth_buffer import DepthBuffer
from shared_schema.common.drawing.drawing import Array, Drawing
from shared_schema.common.drawing.drawn_mesh import Mesh, each_once, surface_faces

ELEVATION, AZIMUTH = np.deg2rad((22.0, -62.0))  # of the eye: to the front, right and above
PARTS = 4  # of an edge, each of which is hidden or not
LIFT = 1.5  # of edges off their surface, in pixels of the depth buffer
HATCH = "/////"


class SpaceDrawing(Drawing):
    """A parallel projection of the body's surface in space."""

    def __init__(self, axes: Axes, mesh: Mesh) -> None:
        super().__init__(axes, mesh)
        axes.set_axis_off()
        self._faces = surface_faces(mesh)
        turn = np.array((np.cos(AZIMUTH), np.sin(AZIMUTH)))
        lift = np.array((np.cos(ELEVATION), np.sin(ELEVATION)))
        self._paper = np.array(
            [[-turn[1], turn[0], 0.0], [-lift[1] * turn[0], -lift[1] * turn[1], lift[0]]]
        )
        self._inward = -np.array([lift[0] * turn[0], lift[0] * turn[1], lift[1]])

    def field(self, x: Array, values: Array) -> ScalarMappable:
        """Shade every boundary face by the mean of its corners."""
        faces = self._from_the_back(x)
        corners = list(self._seen(x)[faces])
        polygons = PolyCollection(corners, cmap="viridis", linewidths=0.2, edgecolors="face")
        polygons.set_array(values[faces].mean(axis=1))
        self.axes.add_collection(polygons)
        return polygons

    def seen_nodes(self, x: Array) -> NDArray[np.int64]:
        """Find the nodes on the surface that no face hides."""
        nodes, buffer = np.unique(self._from_the_back(x)), self._buffer(x)
        return nodes[~self._hidden(buffer, self._lifted(x, buffer.pixel)[nodes])]

    def _edges(self, x: Array) -> list[Array]:
        return self._unhidden(x, each_once(edges_of(self._from_the_back(x))))

    def _outline(self) -> list[Array]:
        """Sharp edges, and those where the surface turns away from the eye."""
        x, faces = self._mesh.coordinates, self._faces
        in_front = np.repeat(self._faces_the_eye(x, faces), faces.shape[1])
        edges, number = np.unique(np.sort(edges_of(faces), axis=1), axis=0, return_inverse=True)
        faces_in_front = np.bincount(number.ravel(), in_front, len(edges))
        turns = faces_in_front == 1
        sharp = sharp_edges(x, faces)
        size = len(x)
        seen = (faces_in_front > 0) & np.isin(edges @ [size, 1], sharp @ [size, 1])
        return self._unhidden(x, edges[turns | seen])

    def _shade(self, x: Array, nodes: NDArray[np.int64]) -> None:
        """Hatch the loaded faces; lightly if they cannot be seen."""
        faces = self._from_the_back(x)
        loaded = faces[np.isin(faces, nodes).all(axis=1)]
        buffer = self._buffer(x)
        middles = self._lifted(x, buffer.pixel)[loaded].mean(axis=1)
        seen = loaded[~self._hidden(buffer, middles)]
        hatched = seen
        if not len(seen):
            hatched = self._faces[np.isin(self._faces, nodes).all(axis=1)]
        self.axes.add_collection(
            PolyCollection(
                list(self._on_paper(x)[hatched]),
                facecolors="none",
                edgecolors="black",
                hatch=HATCH,
                linewidths=0,
                alpha=0.8 if len(seen) else 0.3,
            )
        )

    def _unhidden(self, x: Array, edges: NDArray[np.int64]) -> list[Array]:
        """Lines (2, 2) on the paper: edges (n_edges, 2), whole or the parts that can be seen."""
        ends = np.linspace(0, 1, PARTS + 1)
        buffer = self._buffer(x)
        lifted = self._lifted(x, buffer.pixel)[edges]
        hidden = self._hidden(buffer, _between(lifted, (ends[1:] + ends[:-1]) / 2))
        paper = self._seen(x)[edges]
        whole = list(paper[~hidden.any(axis=1)])
        edge, part = np.nonzero(~hidden & hidden.any(axis=1, keepdims=True))
        points = _between(paper, ends)
        return whole + list(np.stack((points[edge, part], points[edge, part + 1]), axis=1))

    def _hidden(self, buffer: DepthBuffer, points: Array) -> NDArray[np.bool_]:
        """Whether the surface of a depth buffer hides points (…, 3)."""
        return buffer.hides(self._on_paper(points), self._distance(points))

    def _buffer(self, x: Array) -> DepthBuffer:
        return DepthBuffer(self._on_paper(x), self._distance(x), self._from_the_back(x))

    def _lifted(self, x: Array, pixel: float) -> Array:
        """Nodes (n_nodes, 3) a little off the surface, so that it does not hide itself."""
        faces = self._faces
        normal = np.zeros_like(x)
        np.add.at(normal, faces, _normals(x, faces)[:, None])
        length = np.linalg.norm(normal, axis=1, keepdims=True)
        unit = np.divide(normal, length, out=np.zeros_like(x), where=length > 0)
        return np.asarray(x + LIFT * pixel * unit)

    def _faces_the_eye(self, x: Array, faces: NDArray[np.int64]) -> NDArray[np.bool_]:
        return np.asarray(_normals(x, faces) @ self._inward < 0)

    def _from_the_back(self, x: Array) -> NDArray[np.int64]:
        """Faces that are turned to the eye, the farthest first."""
        faces = self._faces[self._faces_the_eye(x, self._faces)]
        order = np.argsort(-self._distance(x)[faces].mean(axis=1), kind="stable")
        return faces[order]

    def _on_paper(self, x: Array) -> Array:
        return np.asarray(x @ self._paper.T)

    def _distance(self, x: Array) -> Array:
        """Distances of points (…, 3) behind the paper, in m."""
        return np.asarray(x @ self._inward)

    def _label_axes(self) -> None:
        """Draw an arrow along each axis, a round number of metres long, below on the left."""
        metres = _round_below(self._size / 4)
        lower, _ = self.extent()
        tips = metres * self._paper.T
        origin = lower - (tips[:, 0].min(), tips[:, 1].max())
        for tip, name in zip(tips, "xyz", strict=True):
            self._arrow(origin, origin + tip, pulls=True, text=name)
            self._drawn.append((origin + tip)[None])
        self._text(origin, np.array([0.0, -1.0]), f"{metres:g} {self.units.length}")


def _normals(x: Array, faces: NDArray[np.int64]) -> Array:
    """Normals (n_faces, 3) of faces, as long as twice their areas in m²."""
    corner = x[faces] - x[faces[:, :1]]
    return np.asarray(np.cross(corner, np.roll(corner, -1, axis=1)).sum(axis=1))


def _between(ends: Array, shares: Array) -> Array:
    """Points at shares (m,) of lines (n, 2, d): (n, m, d)."""
    share = shares[:, None]
    return np.asarray(ends[:, None, 0] * (1 - share) + ends[:, None, 1] * share)


def _round_below(length: float) -> float:
    """Largest of …, 1, 2, 5, 10, … that is not above a length."""
    power = 10.0 ** np.floor(np.log10(length))
    return float(power * max(digit for digit in (1, 2, 5) if digit * power <= length))
