"""Drawings of bodies, in the plane or in space.

A body in space is a parallel projection of its surface. What other faces hide is left out: a depth
buffer has the distance of the nearest face for every pixel of the paper.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure
from matplotlib.tri import Triangulation
from numpy.typing import NDArray

from shared_schema.common.bodies.cells import boundary_facets, edges_of, sharp_edges
from shared_schema.common.drawing.drawing import (
    Array,
    Drawing,
    Mesh,
    each_once,
    surface_edges,
    surface_faces,
)
from shared_schema.common.drawing.figure_style import UNDEFORMED, make_figure, styled

BAND = 4.0  # width in points of a loaded edge


class PlaneDrawing(Drawing):
    """A drawing in the plane."""

    def field(self, x: Array, values: Array) -> ScalarMappable:
        """Shade the cells smoothly; a quadrilateral becomes four triangles round its centre."""
        cells = self._mesh.cells
        if self._mesh.cell_type == "quad":
            centre = len(x) + np.arange(len(cells))
            x = np.concatenate((x, x[cells].mean(axis=1)))
            values = np.concatenate((values, values[cells].mean(axis=1)))
            sides = [(cells[:, i], cells[:, (i + 1) % 4], centre) for i in range(4)]
            cells = np.concatenate([np.stack(side, axis=1) for side in sides])
        x = self._seen(x)
        triangles = Triangulation(x[:, 0], x[:, 1], cells)
        return self.axes.tripcolor(
            triangles, values, shading="gouraud", cmap="viridis", rasterized=True
        )

    def seen_nodes(self, x: Array) -> NDArray[np.int64]:
        """Return the numbers of all nodes."""
        return np.arange(len(x))

    def _edges(self, x: Array) -> list[Array]:
        return list(self._seen(x)[surface_edges(self._mesh)])

    def _outline(self) -> list[Array]:
        return self._edges(self._mesh.coordinates)

    def _shade(self, x: Array, nodes: NDArray[np.int64]) -> None:
        """Draw the loaded edges of the boundary as a wide band."""
        edges = boundary_facets(self._mesh.cells, self._mesh.cell_type)
        loaded = edges[np.isin(edges, nodes).all(axis=1)]
        band = LineCollection(list(x[loaded]), colors="black", alpha=0.4, linewidth=BAND)
        self.axes.add_collection(band)

    def _on_paper(self, x: Array) -> Array:
        return x

    def _from_the_back(self, x: Array) -> NDArray[np.int64]:
        return surface_faces(self._mesh)

    def _label_axes(self) -> None:
        unit = self.units.length
        self.axes.set(xlabel=f"x [{unit}]", ylabel=f"y [{unit}]")


PIXELS = 400  # along the larger side
BEHIND = 0.01  # least distance of a hidden point behind the face, as a part of the larger side


class DepthBuffer:
    """Depths of faces on the paper.

    Parameters
    ----------
    paper : array, (n_nodes, 2)
        Positions of the nodes on the paper in m.
    depth : array, (n_nodes,)
        Their distances behind the paper in m.
    faces : array of int, (n_faces, n_corners)
        Node numbers of plane convex faces.
    """

    def __init__(self, paper: Array, depth: Array, faces: NDArray[np.int64]) -> None:
        self._lower = paper.min(axis=0)
        side = float(np.ptp(paper, axis=0).max())
        self.pixel = side / PIXELS
        self._behind = BEHIND * side
        self._nearest = np.full((PIXELS + 2, PIXELS + 2), np.inf)
        corners = range(1, faces.shape[1] - 1)
        triangles = np.concatenate([faces[:, [0, i, i + 1]] for i in corners])
        point = np.concatenate((paper, depth[:, None]), axis=1)[triangles]
        sides = np.linalg.norm((point - np.roll(point, 1, axis=1))[..., :2], axis=2)
        steps = 2 ** np.ceil(np.log2(np.maximum(sides.max(axis=1) / self.pixel, 1))).astype(int)
        for n in np.unique(steps):
            share = _lattice(int(n))
            samples = np.einsum("sc,tcd->tsd", share, point[steps == n]).reshape(-1, 3)
            np.minimum.at(self._nearest, self._place(samples[:, :2]), samples[:, 2])

    def hides(self, paper: Array, depth: Array) -> NDArray[np.bool_]:
        """Whether faces hide points at these positions (…, 2) and depths (…): bool (…)."""
        return np.asarray(depth > self._nearest[self._place(paper)] + self._behind)

    def _place(self, paper: Array) -> tuple[NDArray[np.int64], ...]:
        """Rows and columns of points (…, 2); those outside are in the empty last ones."""
        cell = np.floor((paper - self._lower) / self.pixel).astype(np.int64)
        outside = ((cell < 0) | (cell > PIXELS)).any(axis=-1)
        cell[outside] = PIXELS + 1
        return cell[..., 0], cell[..., 1]


def _lattice(n: int) -> Array:
    """Barycentric coordinates of the points of a triangle whose sides are cut in n parts."""
    i, j = np.meshgrid(np.arange(n + 1), np.arange(n + 1), indexing="ij")
    inside = i + j <= n
    first, second = i[inside] / n, j[inside] / n
    return np.stack((first, second, 1 - first - second), axis=1)


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


def make_drawing(figure: Figure, mesh: Mesh, position: Any = 111) -> Drawing:
    """Make the drawing that fits the body's dimension, at a position of the figure's grid."""
    kind = PlaneDrawing if mesh.coordinates.shape[1] == 2 else SpaceDrawing
    return kind(figure.add_subplot(position), mesh)


@styled
def deformed_figure(
    mesh: Mesh,
    displacement: Array,
    force: Array,
    values: Array | None = None,
    label: str = r"displacement $\|u\|_2$",
) -> Figure:
    """Draw a body in its deformed state, coloured by the lengths of vectors at its nodes.

    Parameters
    ----------
    mesh : Mesh
    displacement : array, (n_nodes, d)
        In m.
    force : array, (n_nodes, d)
        In N; the longest arrow has a fixed length.
    values : array, (n_nodes, d), optional
        The vectors in m, by default the displacement.
    label : str
        Name of the vectors.
    """
    figure = make_figure(6.4, 3.6)
    drawing = make_drawing(figure, mesh)
    x = mesh.coordinates + displacement
    drawing.undeformed(UNDEFORMED, None, linewidth=0.6)
    length = np.linalg.norm(displacement if values is None else values, axis=1)
    unit, factor = drawing.units.drawn(length)
    drawing.coloured(x, factor * length, f"{label} [{unit}]")
    drawing.forces(x, force)
    drawing.finish()
    return figure
