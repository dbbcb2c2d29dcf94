"""Drawing meshes, nodal fields and forces, in the plane and in space, behind one interface."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any, Protocol

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from matplotlib.tri import Triangulation
from numpy.typing import NDArray

from shared_schema.common.bodies.cells import boundary_facets
from shared_schema.common.bodies.surface_edges import edges_of, sharp_edges

Array = NDArray[np.float64]
Extent = tuple[Array, Array]

ARROW = 0.16  # length of the longest force's arrow, as a part of the body's size
ROOM = np.array((0.9, 0.4))  # for the text beyond an arrow, across and up, as a part of its length
LABELLED = 3  # arrows that get a text at most,
APART = 0.2  # and the distance between their ends at least, as a part of the body's size
MARGIN = 0.04  # free space round what is drawn, as a part of its extent
ON_TOP = 10  # drawing order of what the body must not hide
ELEVATION, AZIMUTH = np.deg2rad((22.0, -62.0))  # of the eye: to the front, right and above


class Mesh(Protocol):
    """The attributes of a mesh that a drawing needs."""

    @property
    def coordinates(self) -> Array:
        """Node positions of the undeformed body, (n_nodes, d) in m."""

    @property
    def cells(self) -> NDArray[np.int64]:
        """Node numbers of every cell, (n_cells, n_corners), VTK order."""

    @property
    def cell_type(self) -> str:
        """Name of the cells in meshio."""


def surface_faces(mesh: Mesh) -> NDArray[np.int64]:
    """Faces that can be seen: the cells of a plane mesh, the boundary faces of one in space.

    Returns
    -------
    array of int, (n_faces, n_corners)
        Node numbers, going round each face.
    """
    if mesh.coordinates.shape[1] == 2:
        return mesh.cells
    return boundary_facets(mesh.cells, mesh.cell_type)


def surface_edges(mesh: Mesh) -> NDArray[np.int64]:
    """Edges of the surface's faces, each once: (n_edges, 2) node numbers."""
    return _each_once(edges_of(surface_faces(mesh)))


def _each_once(edges: NDArray[np.int64]) -> NDArray[np.int64]:
    """Edges, lower node number first, each once: (n_edges, 2)."""
    return np.unique(np.sort(edges, axis=1), axis=0)


class Drawing(ABC):
    """Axes on which a body is drawn, all to one scale.

    Parameters
    ----------
    axes : Axes
    mesh : Mesh
    """

    def __init__(self, axes: Axes, mesh: Mesh) -> None:
        self.axes = axes
        self._mesh = mesh
        self._size = float(np.ptp(mesh.coordinates, axis=0).max())
        self._drawn: list[Array] = []

    @abstractmethod
    def field(self, x: Array, values: Array) -> ScalarMappable:
        """Draw a nodal field (n_nodes,) on the mesh, its nodes at `x` (n_nodes, d) in m."""

    @abstractmethod
    def _edges(self, x: Array) -> NDArray[np.int64]:
        """Edges that can be seen, the nodes at `x` (n_nodes, d): (n_edges, 2) node numbers."""

    @abstractmethod
    def _outline(self) -> NDArray[np.int64]:
        """Edges that stand for the undeformed body: (n_edges, 2) node numbers."""

    @abstractmethod
    def _on_paper(self, x: Array) -> Array:
        """Positions of points (n, d) on the paper: (n, 2), in m."""

    @abstractmethod
    def _distance(self, x: Array) -> Array:
        """Distances of points (n, d) behind the paper: (n,) in m."""

    @abstractmethod
    def _label_axes(self) -> None:
        """Show the directions of the coordinates and the length of a metre."""

    def coloured(
        self,
        x: Array,
        values: Array,
        label: str,
        limits: tuple[float, float] | None = None,
    ) -> None:
        """Draw a nodal field with the mesh's edges, and a colour bar beside it.

        Parameters
        ----------
        x : array, (n_nodes, d)
            Drawn positions of the nodes in m.
        values : array, (n_nodes,)
        label : str
            Name and unit of the values.
        limits : tuple of 2 floats, optional
            Values of the first and the last colour.
        """
        image = self.field(x, values)
        if limits is not None:
            image.set_clim(*limits)
        self.mesh(x, "white", None, linewidth=0.3)
        bar = self.axes.figure.colorbar(image, ax=self.axes, shrink=0.8, pad=0.02)
        bar.set_label(label)
        bar.outline.set_visible(False)

    def mesh(self, x: Array, color: str, label: str | None, **style: Any) -> None:
        """Draw every edge that can be seen of the mesh, its nodes at `x` (n_nodes, d) in m."""
        lines = self._seen(x)[self._edges(x)]
        self.axes.add_collection(LineCollection(list(lines), colors=color, label=label, **style))

    def undeformed(self, color: str, label: str | None, **style: Any) -> None:
        """Draw the undeformed body dashed: its mesh in the plane, its sharp edges in space."""
        lines = self._seen(self._mesh.coordinates)[self._outline()]
        self.axes.add_collection(
            LineCollection(list(lines), colors=color, label=label, linestyle="dashed", **style)
        )

    def body(self, x: Array, color: str, face: str, **style: Any) -> None:
        """Draw edges and faces, those in front over those behind, the nodes at `x` (n_nodes, d)."""
        faces = self._from_the_back(x)
        self.axes.add_collection(
            PolyCollection(list(self._seen(x)[faces]), edgecolors=color, facecolors=face, **style)
        )

    def markers(self, x: Array, color: str, **style: Any) -> None:
        """Mark the points `x` (n_points, d) in m, on top of the body."""
        self.axes.scatter(*self._seen(x).T, color=color, linewidths=0, zorder=ON_TOP, **style)

    def seen_nodes(self, x: Array) -> NDArray[np.int64]:
        """Numbers of the nodes that can be seen, the nodes at `x` (n_nodes, d)."""
        return np.unique(self._edges(x))

    def forces(self, x: Array, force: Array) -> bool:
        """Draw an arrow at each loaded node, the longest of fixed length, others in proportion.

        An arrow that points out of the body begins at its node, any other ends there, so that none
        lies in the body. If they are few and well apart, each has the force's magnitude beside it.

        Parameters
        ----------
        x : array, (n_nodes, d)
            Positions of the drawn nodes, in m.
        force : array, (n_nodes, d)
            In N.

        Returns
        -------
        bool
            True if the magnitudes are written.
        """
        loaded = np.flatnonzero(force.any(axis=1))
        if not loaded.size:
            return True
        magnitude = np.linalg.norm(force[loaded], axis=1)
        step = ARROW * self._size / magnitude.max() * force[loaded]
        around = [x[self._mesh.cells[(self._mesh.cells == n).any(axis=1)]] for n in loaded]
        centre = np.array([corners.mean(axis=(0, 1)) for corners in around])
        pulls = ((x[loaded] - centre) * step).sum(axis=1) >= 0
        node = self._seen(x[loaded])
        free = self._seen(x[loaded] + np.where(pulls[:, None], step, -step))
        said = _stand_apart(free, APART * self._size)
        for i, newtons in enumerate(magnitude):
            self._arrow(node[i], free[i], bool(pulls[i]), f"{newtons:.2f} N" if said else "")
        return said

    def extent(self) -> Extent:
        """Lower and upper corner (2,) of the drawing on the paper in m, with a margin."""
        points = np.concatenate(self._drawn)
        lower, upper = points.min(axis=0), points.max(axis=0)
        margin = MARGIN * (upper - lower).max()
        return lower - margin, upper + margin

    def finish(self, extent: Extent | None = None, labelled: bool = True) -> None:
        """Set limits, equal aspect and labels.

        Parameters
        ----------
        extent : tuple of array (2,), optional
            Lower and upper corner of the visible part; everything that was drawn by default.
        labelled : bool
            Show the directions of the coordinates.
        """
        if labelled:
            self._label_axes()
        lower, upper = extent or self.extent()
        self.axes.set_aspect("equal")
        self.axes.set(xlim=(lower[0], upper[0]), ylim=(lower[1], upper[1]))

    def _seen(self, x: Array) -> Array:
        """Points on the paper, which the extent takes in."""
        self._drawn.append(self._on_paper(x))
        return self._drawn[-1]

    def _from_the_back(self, x: Array) -> NDArray[np.int64]:
        """Faces that can be seen, the farthest first."""
        faces = surface_faces(self._mesh)
        order = np.argsort(-self._distance(x)[faces].mean(axis=1), kind="stable")
        return faces[order]

    def _arrow(self, node: Array, free: Array, pulls: bool, text: str) -> None:
        """Draw an arrow between a node and its free end (2,), where the text is."""
        self.axes.annotate(
            "",
            xy=tuple(free if pulls else node),
            xytext=tuple(node if pulls else free),
            arrowprops={"arrowstyle": "-|>", "color": "black", "shrinkA": 0, "shrinkB": 0},
            zorder=ON_TOP,
        )
        if text:
            self._text(free, free - node, text)

    def _text(self, at: Array, away: Array, text: str) -> None:
        """Write text beyond a point (2,) in a direction (2,)."""
        direction = away / (np.linalg.norm(away) or 1.0)
        across, up = np.sign(direction.round()).astype(int)
        self._drawn.append((at + direction * ROOM * ARROW * self._size)[None])
        self.axes.annotate(
            text,
            xy=tuple(at),
            xytext=tuple(4 * direction),
            textcoords="offset points",
            ha={-1: "right", 0: "center", 1: "left"}[across],
            va={-1: "top", 0: "center", 1: "bottom"}[up],
            path_effects=[withStroke(linewidth=2, foreground="white")],
            zorder=ON_TOP + 1,
        )


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

    def _edges(self, x: Array) -> NDArray[np.int64]:
        return surface_edges(self._mesh)

    def _outline(self) -> NDArray[np.int64]:
        return surface_edges(self._mesh)

    def _on_paper(self, x: Array) -> Array:
        return x

    def _distance(self, x: Array) -> Array:
        return np.zeros(len(x))

    def _label_axes(self) -> None:
        self.axes.set(xlabel="x [m]", ylabel="y [m]")


class SpaceDrawing(Drawing):
    """A parallel projection of the body's surface in space."""

    def __init__(self, axes: Axes, mesh: Mesh) -> None:
        super().__init__(axes, mesh)
        axes.set_axis_off()
        turn = np.array((np.cos(AZIMUTH), np.sin(AZIMUTH)))
        lift = np.array((np.cos(ELEVATION), np.sin(ELEVATION)))
        self._paper = np.array(
            [[-turn[1], turn[0], 0.0], [-lift[1] * turn[0], -lift[1] * turn[1], lift[0]]]
        )
        self._inward = -np.array([lift[0] * turn[0], lift[0] * turn[1], lift[1]])

    def field(self, x: Array, values: Array) -> ScalarMappable:
        """Shade every boundary face by the mean of its corners."""
        faces = self._from_the_back(x)
        polygons = PolyCollection(list(self._seen(x)[faces]), cmap="viridis", linewidths=0.0)
        polygons.set_array(values[faces].mean(axis=1))
        self.axes.add_collection(polygons)
        return polygons

    def _edges(self, x: Array) -> NDArray[np.int64]:
        """Edges of the faces that are turned to the eye: those that go round anticlockwise."""
        faces = surface_faces(self._mesh)
        corner = self._on_paper(x)[faces]
        following = np.roll(corner, -1, axis=1)
        area = corner[..., 0] * following[..., 1] - corner[..., 1] * following[..., 0]
        return _each_once(edges_of(faces[area.sum(axis=1) > 0]))

    def _outline(self) -> NDArray[np.int64]:
        return sharp_edges(self._mesh.coordinates, surface_faces(self._mesh))

    def _on_paper(self, x: Array) -> Array:
        return np.asarray(x @ self._paper.T)

    def _distance(self, x: Array) -> Array:
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
        self._text(origin, np.array([0.0, -1.0]), f"{metres:g} m")


def _stand_apart(points: Array, distance: float) -> bool:
    """True if points (n, 2) are few and no two of them are nearer to each other."""
    if len(points) > LABELLED:
        return False
    one, other = np.triu_indices(len(points), 1)
    return bool((np.linalg.norm(points[one] - points[other], axis=1) >= distance).all())


def _round_below(length: float) -> float:
    """Largest of …, 1, 2, 5, 10, … that is not above a length."""
    power = 10.0 ** np.floor(np.log10(length))
    return float(power * max(digit for digit in (1, 2, 5) if digit * power <= length))


def make_drawing(figure: Figure, mesh: Mesh, position: Any = 111) -> Drawing:
    """Make the drawing that fits the body's dimension, at a position of the figure's grid."""
    kind = PlaneDrawing if mesh.coordinates.shape[1] == 2 else SpaceDrawing
    return kind(figure.add_subplot(position), mesh)
