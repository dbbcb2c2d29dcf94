"""Drawing meshes and nodal fields, in the plane and in space, behind one interface."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.tri import Triangulation
from mpl_toolkits.mplot3d.art3d import Line3DCollection, Poly3DCollection
from numpy.typing import NDArray

from shared_schema.cells import boundary_facets
from surrogate.geometry import Geometry

Array = NDArray[np.float64]

ARROW = 0.16  # length of a force's arrow, as a part of the body's size


def surface_faces(geometry: Geometry) -> NDArray[np.int64]:
    """Faces that can be seen: the cells of a plane mesh, the boundary faces of one in space.

    Returns
    -------
    array of int, (n_faces, n_corners)
        Node numbers, going round each face.
    """
    if geometry.dimension == 2:
        return geometry.cells
    return boundary_facets(geometry.cells, geometry.cell_type)


def surface_edges(geometry: Geometry) -> NDArray[np.int64]:
    """Edges of the faces that can be seen, each once: (n_edges, 2) node numbers."""
    faces = surface_faces(geometry)
    edges = np.stack((faces, np.roll(faces, -1, axis=1)), axis=-1).reshape(-1, 2)
    return np.unique(np.sort(edges, axis=1), axis=0)


class Drawing(ABC):
    """Axes on which a body is drawn.

    Parameters
    ----------
    figure : Figure
        Made anew for this drawing.
    geometry : Geometry
    """

    def __init__(self, figure: Figure, geometry: Geometry) -> None:
        self.figure = figure
        self.geometry = geometry
        self.size = float(np.ptp(geometry.coordinates, axis=0).max())

    @abstractmethod
    def mesh(self, x: Array, color: str, label: str | None, **style: Any) -> None:
        """Draw the edges of the mesh, its nodes at `x` (n_nodes, d) in m."""

    @abstractmethod
    def field(self, x: Array, values: Array) -> ScalarMappable:
        """Draw a nodal field (n_nodes,) on the mesh, its nodes at `x` (n_nodes, d) in m."""

    @abstractmethod
    def arrow(self, tail: Array, head: Array, text: str) -> None:
        """Draw an arrow from `tail` to `head` (d,) in m, with some text at its tail."""

    @abstractmethod
    def finish(self) -> None:
        """Set limits, aspect and labels."""

    def forces(self, x: Array, force: Array) -> None:
        """Draw an arrow of fixed length to each loaded node, with the force's magnitude.

        Parameters
        ----------
        x : array, (n_nodes, d)
            Where the nodes are drawn, in m.
        force : array, (n_nodes, d)
            In N.
        """
        for node in np.flatnonzero(force.any(axis=1)):
            magnitude = float(np.linalg.norm(force[node]))
            tail = x[node] - ARROW * self.size * force[node] / magnitude
            self.arrow(tail, x[node], f"{magnitude:.2f} N")


class PlaneDrawing(Drawing):
    """A drawing in the plane."""

    def __init__(self, figure: Figure, geometry: Geometry) -> None:
        super().__init__(figure, geometry)
        self.axes = figure.subplots()

    def mesh(self, x: Array, color: str, label: str | None, **style: Any) -> None:
        """Draw every edge of every cell."""
        lines = list(x[surface_edges(self.geometry)])
        self.axes.add_collection(LineCollection(lines, colors=color, label=label, **style))

    def field(self, x: Array, values: Array) -> ScalarMappable:
        """Shade the cells smoothly; a quadrilateral becomes four triangles round its centre."""
        cells = self.geometry.cells
        if self.geometry.cell_type == "quad":
            centre = len(x) + np.arange(len(cells))
            x = np.concatenate((x, x[cells].mean(axis=1)))
            values = np.concatenate((values, values[cells].mean(axis=1)))
            sides = [(cells[:, i], cells[:, (i + 1) % 4], centre) for i in range(4)]
            cells = np.concatenate([np.stack(side, axis=1) for side in sides])
        triangles = Triangulation(x[:, 0], x[:, 1], cells)
        return self.axes.tripcolor(
            triangles, values, shading="gouraud", cmap="viridis", rasterized=True
        )

    def arrow(self, tail: Array, head: Array, text: str) -> None:
        """Draw it in the plane, and leave room for the text."""
        self.axes.update_datalim([tuple(tail), (tail[0] + 0.6 * ARROW * self.size, tail[1])])
        style: Any = {"arrowstyle": "-|>", "color": "black", "lw": 1.0, "shrinkA": 0}
        self.axes.annotate("", xy=tuple(head), xytext=tuple(tail), arrowprops=style)
        self.axes.annotate(
            text, xy=tuple(tail), xytext=(4, 0), textcoords="offset points", va="center"
        )

    def finish(self) -> None:
        """Set equal aspect, and metres at the axes."""
        self.axes.set_aspect("equal")
        self.axes.autoscale_view()
        self.axes.margins(0.04)
        self.axes.set_xlabel("x [m]")
        self.axes.set_ylabel("y [m]")


class SpaceDrawing(Drawing):
    """A drawing of the body's surface in space, seen from the front right above."""

    def __init__(self, figure: Figure, geometry: Geometry) -> None:
        super().__init__(figure, geometry)
        self.axes: Any = figure.add_subplot(projection="3d", computed_zorder=False)
        self.axes.view_init(elev=22, azim=-62)
        self._points: list[Array] = []

    def mesh(self, x: Array, color: str, label: str | None, **style: Any) -> None:
        """Draw the edges of the boundary faces."""
        self._points.append(x)
        lines = x[surface_edges(self.geometry)]
        self.axes.add_collection3d(Line3DCollection(lines, colors=color, label=label, **style))

    def field(self, x: Array, values: Array) -> ScalarMappable:
        """Shade every boundary face by the mean of its corners."""
        self._points.append(x)
        faces = surface_faces(self.geometry)
        polygons: ScalarMappable = Poly3DCollection(x[faces], cmap="viridis", linewidths=0.0)
        polygons.set_array(values[faces].mean(axis=1))
        self.axes.add_collection3d(polygons)
        return polygons

    def arrow(self, tail: Array, head: Array, text: str) -> None:
        """Draw it as a quiver."""
        self._points.append(tail[None])
        self.axes.quiver(*tail, *(head - tail), color="black", lw=1.0, arrow_length_ratio=0.25)
        self.axes.text(*tail, text)

    def finish(self) -> None:
        """Set limits to what was drawn, equal aspect, and metres at the axes."""
        points = np.concatenate(self._points)
        lower, upper = points.min(axis=0), points.max(axis=0)
        self.axes.set(xlim=(lower[0], upper[0]), ylim=(lower[1], upper[1]))
        self.axes.set(zlim=(lower[2], upper[2]))
        self.axes.set_box_aspect(upper - lower)
        self.axes.set(xlabel="x [m]", ylabel="y [m]", zlabel="z [m]")
        self.axes.locator_params(nbins=4)


def make_drawing(figure: Figure, geometry: Geometry) -> Drawing:
    """Make the drawing that fits the body's dimension."""
    kind = PlaneDrawing if geometry.dimension == 2 else SpaceDrawing
    return kind(figure, geometry)
