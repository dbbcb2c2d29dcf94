"""What drawings in the plane and in space share: meshes, fields, marks, loads, limits.

Loaded nodes that share cells form a patch. A patch of more than `FEW` nodes is a distributed load:
it has one symbol with the resultant. If it holds nodes inside the body, it is a body force;
otherwise it is a traction or a pressure on the faces between its nodes. A node of a patch whose
force is more than `CONCENTRATED` times that of nine tenths of its patch has its own arrow.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.patheffects import withStroke
from numpy.typing import NDArray

from shared_schema.common.bodies.cells import FACETS, boundary_facets, components, edges_of
from shared_schema.common.units import SI, Units

Array = NDArray[np.float64]


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


def units_of(mesh: Mesh) -> Units:
    """Units that a drawing of a mesh names: its attribute `units`, or metres and newtons."""
    units = getattr(mesh, "units", SI)
    return units if isinstance(units, Units) else SI


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


def cells_of_faces(mesh: Mesh, faces: NDArray[np.int64]) -> NDArray[np.int64]:
    """Find the cell that each of the faces belongs to, (n_faces,); plane faces are the cells."""
    kinds = FACETS[mesh.cell_type] if mesh.coordinates.shape[1] == 3 else [slice(None)]
    every = np.concatenate([mesh.cells[:, kind] for kind in kinds])
    rows = np.sort(np.concatenate([every, faces]), axis=1)
    _, number = np.unique(rows, axis=0, return_inverse=True)
    number = number.ravel()
    cell_of = np.zeros(number.max() + 1, dtype=np.int64)
    cell_of[number[: len(every)]] = np.tile(np.arange(len(mesh.cells)), len(kinds))
    return np.asarray(cell_of[number[len(every) :]])


def surface_edges(mesh: Mesh) -> NDArray[np.int64]:
    """Edges of the surface's faces, each once: (n_edges, 2) node numbers."""
    return each_once(edges_of(surface_faces(mesh)))


def each_once(edges: NDArray[np.int64]) -> NDArray[np.int64]:
    """Edges, lower node number first, each once: (n_edges, 2)."""
    return np.unique(np.sort(edges, axis=1), axis=0)


FEW = 12  # nodes of a patch that have an arrow each
CONCENTRATED, MOST = 10.0, 0.9


@dataclass(frozen=True)
class LoadSymbol:
    """One load of a drawing.

    Attributes
    ----------
    nodes : array of int, (n,)
        Loaded nodes.
    at : array, (d,)
        Point of application in m: the mean position of the nodes, weighted by their forces.
    force : array, (d,)
        Resultant in N.
    distributed : bool
        Whether it is a distributed load.
    inside : bool
        Whether it also acts on nodes inside the body.
    """

    nodes: NDArray[np.int64]
    at: Array
    force: Array
    distributed: bool = False
    inside: bool = False


def load_symbols(mesh: Mesh, x: Array, force: Array) -> list[LoadSymbol]:
    """Find the symbols of nodal forces.

    Parameters
    ----------
    mesh : Mesh
    x, force : array, (n_nodes, d)
        Drawn positions of the nodes in m, and forces in N.
    """
    magnitude = np.linalg.norm(force, axis=1)
    boundary = np.unique(boundary_facets(mesh.cells, mesh.cell_type))
    symbols = []
    for patch in _patches(mesh, magnitude > 0):
        single = np.full(len(patch), len(patch) <= FEW)
        single |= magnitude[patch] > CONCENTRATED * np.quantile(magnitude[patch], MOST)
        symbols += [
            LoadSymbol(patch[[i]], x[patch[i]], force[patch[i]]) for i in single.nonzero()[0]
        ]
        rest = patch[~single]
        if len(rest):
            at = np.average(x[rest], axis=0, weights=magnitude[rest])
            inside = not np.isin(rest, boundary).all()
            symbols.append(LoadSymbol(rest, at, force[rest].sum(axis=0), True, inside))
    return symbols


def _patches(mesh: Mesh, loaded: NDArray[np.bool_]) -> list[NDArray[np.int64]]:
    """Sets of loaded nodes that hang together by cells, in the order of their lowest nodes."""
    cell, corner = np.nonzero(loaded[mesh.cells])
    nodes, count = mesh.cells[cell, corner], len(loaded)
    patch = components(nodes, count + cell, count + len(mesh.cells))[:count]
    return [np.flatnonzero(loaded & (patch == number)) for number in np.unique(patch[loaded])]


Extent = tuple[Array, Array]

ARROW = 0.16  # length of the longest force's arrow, as a part of the body's size
ROOM = np.array((0.9, 0.4))  # for the text beyond an arrow, across and up, as a part of its length
LABELLED = 3  # arrows that get a text at most,
APART = 0.2  # and the distance between their ends at least, as a part of the body's size
MARGIN = 0.04  # free space round what is drawn, as a part of its extent
ON_TOP = 10  # drawing order of what the body must not hide
LINE = 0.6  # length of a direction, as a part of the size of its cell
BALANCED = 0.01  # resultant without an arrow, as a part of the sum of its nodes' forces


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
        self.units = units_of(mesh)
        self._size = float(np.ptp(mesh.coordinates, axis=0).max())
        self._drawn: list[Array] = []

    @abstractmethod
    def field(self, x: Array, values: Array) -> ScalarMappable:
        """Draw a nodal field (n_nodes,) on the mesh, its nodes at `x` (n_nodes, d) in m."""

    @abstractmethod
    def _edges(self, x: Array) -> list[Array]:
        """Lines (2, 2) on the paper, in m: all edges as far as they can be seen, nodes at `x`."""

    @abstractmethod
    def _outline(self) -> list[Array]:
        """Lines (2, 2) on the paper, in m, that stand for the undeformed body."""

    @abstractmethod
    def seen_nodes(self, x: Array) -> NDArray[np.int64]:
        """Numbers of the nodes that can be seen, the nodes at `x` (n_nodes, d)."""

    @abstractmethod
    def _shade(self, x: Array, nodes: NDArray[np.int64]) -> None:
        """Mark the loaded part of the surface between some nodes."""

    @abstractmethod
    def _on_paper(self, x: Array) -> Array:
        """Positions of points (n, d) on the paper: (n, 2), in m."""

    @abstractmethod
    def _from_the_back(self, x: Array) -> NDArray[np.int64]:
        """Faces (n_faces, n_corners) that can be seen, the farthest first, the nodes at `x`."""

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
        lines = LineCollection(self._edges(x), colors=color, label=label, **style)
        self.axes.add_collection(lines)

    def undeformed(self, color: str, label: str | None, **style: Any) -> None:
        """Draw the undeformed body dashed: its mesh in the plane, its outline in space."""
        self.axes.add_collection(
            LineCollection(self._outline(), colors=color, label=label, linestyle="dashed", **style)
        )

    def body(self, x: Array, color: str, face: str, **style: Any) -> None:
        """Draw edges and faces, those in front over those behind, the nodes at `x` (n_nodes, d)."""
        faces = self._from_the_back(x)
        self.axes.add_collection(
            PolyCollection(list(self._seen(x)[faces]), edgecolors=color, facecolors=face, **style)
        )

    def line(self, x: Array, color: str, **style: Any) -> None:
        """Draw a line through the points `x` (n_points, d) in m, on top of the body."""
        self.axes.plot(*self._seen(x).T, color=color, zorder=ON_TOP, **style)

    def markers(self, x: Array, color: str, **style: Any) -> None:
        """Mark the points `x` (n_points, d) in m, on top of the body."""
        self.axes.scatter(*self._seen(x).T, color=color, linewidths=0, zorder=ON_TOP, **style)

    def directions(self, vectors: Array, color: str, **style: Any) -> None:
        """Draw a line on each undeformed face that can be seen, along the direction of its cell.

        Parameters
        ----------
        vectors : array, (n_cells, d)
            Unit vectors, or 0 where there is none. Lines are as long as a part of the shortest
            side of their face.
        color : str
        style
            Of matplotlib's lines.
        """
        x = self._mesh.coordinates
        faces = self._from_the_back(x)
        along = vectors[cells_of_faces(self._mesh, faces)]
        corners = x[faces]
        sides = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).min(axis=1)
        middles, half = corners.mean(axis=1), LINE / 2 * sides[:, None] * along
        there = along.any(axis=1)
        ends = (self._on_paper((middles + sign * half)[there]) for sign in (-1, 1))
        lines = list(np.stack(tuple(ends), axis=1))
        self.axes.add_collection(LineCollection(lines, colors=color, zorder=ON_TOP, **style))

    def forces(self, x: Array, force: Array) -> bool:
        """Draw the loads: the longest arrow of fixed length, others in proportion.

        A concentrated force is an arrow at its node. A distributed load is one arrow for its
        resultant, and a shading of the surface that it acts on. An arrow that points out of the
        body begins at its place, any other ends there, so that none lies in the body; that of a
        body force begins in the middle of the body. If they are few and well apart, each has the
        force's magnitude beside it.

        Parameters
        ----------
        x : array, (n_nodes, d)
            Positions of the drawn nodes, in m.
        force : array, (n_nodes, d)
            In N.

        Returns
        -------
        bool
            True if the magnitudes of all loads are written.
        """
        arrows = []
        for symbol in load_symbols(self._mesh, x, force):
            if symbol.distributed and not symbol.inside:
                self._shade(x, symbol.nodes)
            sum_of_forces = np.linalg.norm(force[symbol.nodes], axis=1).sum()
            if np.linalg.norm(symbol.force) > BALANCED * sum_of_forces:
                arrows.append(symbol)
        if not arrows:
            return not force.any()
        at, resultant = np.array([a.at for a in arrows]), np.array([a.force for a in arrows])
        magnitude = np.linalg.norm(resultant, axis=1)
        step = ARROW * self._size / magnitude.max() * resultant
        centre = np.array(
            [x.mean(axis=0) if a.distributed else self._middle(x, a.nodes[0]) for a in arrows]
        )
        inside = np.array([a.inside for a in arrows])
        pulls = (((at - centre) * step).sum(axis=1) >= 0) | inside
        node = self._seen(at)
        free = self._seen(at + np.where(pulls[:, None], step, -step))
        said = _stand_apart(free, APART * self._size)
        for i, newtons in enumerate(magnitude):
            text = f"{newtons:.3g} {self.units.force}" if said else ""
            self._arrow(node[i], free[i], bool(pulls[i]), text)
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

    def _middle(self, x: Array, node: int) -> Array:
        """Mean position (d,) of the corners of the cells at a node, in m."""
        cells = self._mesh.cells[(self._mesh.cells == node).any(axis=1)]
        return np.asarray(x[cells].mean(axis=(0, 1)))

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


def _stand_apart(points: Array, distance: float) -> bool:
    """True if points (n, 2) are few and no two of them are nearer to each other."""
    if len(points) > LABELLED:
        return False
    one, other = np.triu_indices(len(points), 1)
    return bool((np.linalg.norm(points[one] - points[other], axis=1) >= distance).all())
