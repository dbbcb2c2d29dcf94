r"""A rigid body with any closed surface of triangles, such as an STL file, at a pose.

.. math:: g(x) = ± |x - p(x)| - r

with the nearest point p of the surface. The sign is that of :math:`(x - p) · N` with the normal N
of the face, edge or corner that p lies on: the sum of the normals of its faces, for a corner
weighted with their angles (Bærentzen and Aanæs 2005, *IEEE Trans. Vis. Comput. Graph.* 11). The
surface is rounded by r, so that its edges have a normal that turns smoothly.
"""

from __future__ import annotations

import io
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from shared_schema.common.errors import InputError, first_line
from shared_schema.points_in_cells import PointTree
from shared_schema.tools.tool import MOST, Tool, require_points


def read_by_meshio(path: Path) -> Any:
    """Read a file: a ``meshio.Mesh``.

    Raises
    ------
    ValueError
        If meshio cannot read it, with the reason, which meshio prints before it exits.
    """
    import meshio

    said = io.StringIO()
    try:
        # what meshio tries of a text file may be no number
        with np.errstate(over="ignore"), redirect_stdout(said), redirect_stderr(io.StringIO()):
            return meshio.read(path)
    except (Exception, SystemExit) as error:
        name = "" if isinstance(error, (ValueError, SystemExit)) else f"{type(error).__name__}: "
        reason = " ".join(said.getvalue().split()) or name + first_line(error)
        if isinstance(error, SystemExit) and not said.getvalue().strip():
            reason = "not a file of the format that its name says"
        raise ValueError(reason) from None


Array = NDArray[np.float64]
Numbers = NDArray[np.int64]
ROUNDED = 0.01  # of the largest extent
FLAT = 1e-12  # of the largest extent: height of a triangle that is none, distance without direction
EQUAL = 1e-7  # of the largest coordinate: difference of points of two triangles that are one
PAIRS = 2_000_000  # positions and triangles that are looked at together
CORNERS = ((0, 1), (1, 2), (2, 0))  # of the edges of a triangle
CUTS = {"triangle": ([0, 1, 2],), "quad": ([0, 1, 2], [0, 2, 3])}  # into triangles


def read_triangles(path: Path, scale: float = 1.0) -> tuple[Array, Numbers]:
    """Read the triangles of a file such as STL, OBJ or PLY; quadrilaterals are cut in two.

    Parameters
    ----------
    path : Path
    scale : float
        Length in m of a unit of the file.

    Returns
    -------
    corners : array, (n_corners, 3)
        In m, those joined that are equal but for the rounding of single precision.
    triangles : array of int, (n_triangles, 3)
        Without flat ones.

    Raises
    ------
    ValueError
        If meshio reads no triangles from it, or a coordinate is not fit for use.
    """
    try:
        mesh = read_by_meshio(path)
    except ValueError as error:
        raise ValueError(f"no surface that meshio reads ({error})") from None
    found = [np.empty((0, 3), np.int64)]
    for block in mesh.cells:
        for cut in CUTS.get(block.type, ()):
            found.append(np.asarray(block.data, np.int64)[:, cut])
    triangles = np.concatenate(found)
    if not len(triangles):
        raise ValueError("expected triangles, found none")
    points = np.asarray(mesh.points, np.float64) * scale
    if points.shape[1] != 3 or not np.isfinite(points).all() or np.abs(points).max() > MOST:
        raise ValueError(f"expected points of 3 finite coordinates, at most {MOST:g} m")
    whole = np.round(points / (EQUAL * max(np.abs(points).max(), 1e-300)))
    _, first, numbers = np.unique(whole, axis=0, return_index=True, return_inverse=True)
    corners = points[first]
    triangles = numbers.ravel()[triangles]
    sides = corners[triangles[:, [1, 2, 0]]] - corners[triangles]
    heights = np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1)
    length = np.linalg.norm(sides, axis=2).max(axis=1, initial=0.0)
    extent = float(np.ptp(corners, axis=0).max(initial=0.0))
    return corners, triangles[heights > FLAT * extent * length]


class Mesh(Tool):
    """A closed surface of triangles.

    >>> probe = Mesh("probe.stl", place=(0, 0, 0.1), turn=(0, np.pi / 2, 0))  # doctest: +SKIP

    Parameters
    ----------
    path : str or Path
        File of triangles that meshio reads, such as STL, with lengths in m.
    place : tuple of 3 floats
        Where the origin of the file is, in m.
    turn : tuple of 3 floats
        Rotation about the origin of the file before that: its axis, of the length of its angle in
        radians.
    scale : float
        Length in m of a unit of the file.
    rounding : float, optional
        Radius r in m by which the surface is larger than that of the file, so that its edges are
        round; a hundredth of its largest extent by default.

    Raises
    ------
    InputError
        If the file cannot be read or holds no closed surface, or a number is wrong.
    """

    form: ClassVar[str] = "mesh:FILE[:X,Y,Z[:RX,RY,RZ[:SCALE]]]"

    def __init__(
        self,
        path: str | Path,
        place: tuple[float, ...] = (0.0, 0.0, 0.0),
        turn: tuple[float, ...] = (0.0, 0.0, 0.0),
        scale: float = 1.0,
        rounding: float | None = None,
    ) -> None:
        if not 0 < scale <= MOST:
            raise InputError(f"mesh: scale {scale:g}: expected more than 0, at most {MOST:g}")
        self._surface = Surface.read(Path(path), scale)
        if rounding is None:
            rounding = ROUNDED * self._surface.extent
        if not 0 <= rounding <= MOST:
            raise InputError(
                f"mesh: rounding {rounding:g}: expected 0 m at least, at most {MOST:g}"
            )
        self.rounding = rounding
        self._move(place, turn)

    def moved(self, place: tuple[float, ...], turn: tuple[float, ...] = (0.0, 0.0, 0.0)) -> Mesh:
        """The same surface at another pose."""
        other: Mesh = object.__new__(Mesh)
        other._surface, other.rounding = self._surface, self.rounding
        other._move(place, turn)
        return other

    def _move(self, place: tuple[float, ...], turn: tuple[float, ...]) -> None:
        require_points("mesh", place, turn)
        if len(place) != 3:
            raise InputError("mesh: expected 3 components of its place and its turn")
        self.place, self.turn = tuple(place), tuple(turn)
        self._origin, self._axes = np.array(place), Rotation.from_rotvec(turn).as_matrix()
        self._last: tuple[Array, Nearest] | None = None

    @property
    def dimension(self) -> int:
        """Number of space dimensions."""
        return 3

    @property
    def size(self) -> float:
        """Largest coordinate of its corners."""
        return float(np.abs(self._corners).max()) + self.rounding

    @property
    def inside(self) -> Array:
        """Mean of its corners."""
        return np.asarray(self._corners.mean(axis=0))

    @property
    def _corners(self) -> Array:
        """Where they are in m, (n, 3)."""
        return np.asarray(self._surface.corners @ self._axes.T + self._origin)

    def gap(self, x: Array) -> Array:
        """Signed distance."""
        return self._nearest(x).distance - self.rounding

    def normal(self, x: Array) -> Array:
        """Its gradient."""
        return np.asarray(self._nearest(x).normal @ self._axes.T)

    def curvature(self, x: Array) -> Array:
        """Its Hessian: (I − n nᵀ − t tᵀ) / |x − p| about an edge t, without t about a corner."""
        found = self._nearest(x)
        n, t = found.normal, found.edge
        across = np.eye(3) - n[:, :, None] * n[:, None, :] - t[:, :, None] * t[:, None, :]
        isbent = ~found.on_face & (np.abs(found.distance) > FLAT * self._surface.extent)
        across /= np.where(isbent, found.distance, np.inf)[:, None, None]
        return np.asarray(self._axes @ across @ self._axes.T)

    def _nearest(self, x: Array) -> Nearest:
        if self._last is None or not np.array_equal(self._last[0], x):
            self._last = x.copy(), self._surface.nearest((x - self._origin) @ self._axes)
        return self._last[1]


@dataclass(frozen=True)
class Nearest:
    """The points of a surface that are nearest to some positions.

    Attributes
    ----------
    distance : array, (n,)
        In m, negative inside.
    normal : array, (n, 3)
        Gradient of the distance, of length 1.
    edge : array, (n, 3)
        Direction of the edge that the point lies on, of length 1; 0 on faces and at corners.
    on_face : array of bool, (n,)
    """

    distance: Array
    normal: Array
    edge: Array
    on_face: NDArray[np.bool_]


class Surface:
    """A closed surface of triangles, seen from outside.

    Parameters
    ----------
    corners : array, (n_corners, 3)
        In m.
    triangles : array of int, (n_triangles, 3)

    Attributes
    ----------
    extent : float
        Largest extent in m.

    Raises
    ------
    InputError
        If the surface is not closed, or its triangles are not all seen from one side.
    """

    def __init__(self, corners: Array, triangles: Numbers) -> None:
        used, numbers = np.unique(triangles, return_inverse=True)
        self.corners, triangles = corners[used], numbers.reshape(-1, 3)
        self.extent = float(np.ptp(self.corners, axis=0).max())
        ends = triangles[:, CORNERS].reshape(-1, 2)
        require_closed(ends)
        points = self.corners[triangles]
        if np.linalg.det(points - self.corners.mean(axis=0)).sum() < 0:
            triangles, points = triangles[:, ::-1], points[:, ::-1]
            ends = triangles[:, CORNERS].reshape(-1, 2)
        self.triangles, self._points = triangles, points
        area = np.cross(points[:, 1] - points[:, 0], points[:, 2] - points[:, 0])
        faces = area / np.linalg.norm(area, axis=1, keepdims=True)
        sides = points[:, [1, 2, 0]] - points
        self._directions = sides / np.linalg.norm(sides, axis=2, keepdims=True)
        cosines = -(self._directions * self._directions[:, [2, 0, 1]]).sum(axis=2)
        angles = np.arccos(np.clip(cosines, -1, 1))
        at_corners = np.zeros(self.corners.shape)
        np.add.at(at_corners, triangles, angles[:, :, None] * faces[:, None])
        names = ends.min(axis=1) * len(self.corners) + ends.max(axis=1)
        _, number = np.unique(names, return_inverse=True)
        at_edges = np.zeros((number.max() + 1, 3))
        np.add.at(at_edges, number.ravel(), np.repeat(faces, 3, axis=0))
        # normals of what a nearest point lies on: its face, an edge, a corner
        edges = at_edges[number.reshape(-1, 3)]
        self._normals = np.concatenate([faces[:, None], edges, at_corners[triangles]], axis=1)
        centres = points.mean(axis=1)
        self._reach = float(np.linalg.norm(points - centres[:, None], axis=2).max())
        self._of_corners, self._of_centres = PointTree(self.corners), PointTree(centres)

    @classmethod
    def read(cls, path: Path, scale: float) -> Surface:
        """Read a file; InputError if it holds no closed surface of triangles."""
        try:
            corners, triangles = read_triangles(path, scale)
            return cls(corners, triangles)
        except (ValueError, InputError) as error:
            raise InputError(f"{path}: {error}") from None

    def nearest(self, x: Array) -> Nearest:
        """Find the nearest points to positions, (n, 3)."""
        bound = self._of_corners.query(x)[0] + self._reach
        near = self._of_centres.query_ball_point(x, bound * (1 + 1e-9))
        counts = np.array([len(each) for each in near])
        parts, start = [], 0
        total = np.cumsum(counts)
        while start < len(x):
            before = total[start] - counts[start]
            end = max(start + 1, int(np.searchsorted(total, before + PAIRS, side="right")))
            parts.append(self._nearest_of(x[start:end], near[start:end], counts[start:end]))
            start = end
        if not parts:
            none = np.empty((0, 3))
            return Nearest(np.empty(0), none, none, np.empty(0, np.bool_))
        return Nearest(*map(np.concatenate, zip(*parts, strict=True)))

    def _nearest_of(
        self, x: Array, near: NDArray[np.object_], counts: Numbers
    ) -> tuple[Array, Array, Array, NDArray[np.bool_]]:
        """Distances, normals, edges and whether they are on faces, of some positions."""
        of = np.concatenate([np.asarray(each, np.int64) for each in near])
        offset, part = from_triangles(np.repeat(x, counts, axis=0), self._points[of])
        squares = (offset**2).sum(axis=1)
        starts = np.cumsum(counts) - counts
        least = np.repeat(np.minimum.reduceat(squares, starts), counts)
        first = np.flatnonzero(squares == least)
        owner = np.repeat(np.arange(len(x)), counts)[first]
        _, one = np.unique(owner, return_index=True)
        best = first[one]
        offset, part, of = offset[best], part[best], of[best]
        length = np.linalg.norm(offset, axis=1)
        outward = self._normals[of, part]
        sign = np.where((offset * outward).sum(axis=1) < 0, -1.0, 1.0)
        outward = outward / np.linalg.norm(outward, axis=1, keepdims=True)
        isclear = (length > FLAT * self.extent) & (part > 0)
        along = sign[:, None] * offset / np.where(isclear, length, 1.0)[:, None]
        on_edge = (part > 0) & (part <= 3)
        edge = self._directions[of, np.where(on_edge, part - 1, 0)] * on_edge[:, None]
        return sign * length, np.where(isclear[:, None], along, outward), edge, part == 0


def require_closed(ends: Numbers) -> None:
    """Raise InputError unless every edge, (n, 2) corners, is there once in each direction."""
    if not len(ends):
        raise InputError("expected triangles, found none")
    _, times = np.unique(np.sort(ends, axis=1), axis=0, return_counts=True)
    if (times != 2).any():
        raise InputError(
            f"expected a closed surface, found {np.count_nonzero(times != 2)} edges that do not "
            "belong to two triangles"
        )
    if len(np.unique(ends, axis=0)) < len(ends):
        raise InputError("expected triangles that are all seen from outside, or all from inside")


def from_triangles(x: Array, points: Array) -> tuple[Array, Numbers]:
    """From the nearest points of triangles to positions.

    The parts of a triangle are those of Ericson 2005, *Real-Time Collision Detection*.

    Parameters
    ----------
    x : array, (n, 3)
    points : array, (n, 3, 3)
        Corners.

    Returns
    -------
    offset : array, (n, 3)
    part : array of int, (n,)
        0 on the face; 1, 2, 3 on the edge that begins at corner 0, 1, 2; 4, 5, 6 at the corner.
    """
    sides = points[:, [1, 2, 0]] - points
    relative = x[:, None] - points
    along = (relative * sides).sum(axis=2) / (sides**2).sum(axis=2)
    on_edges = relative - np.clip(along, 0, 1)[:, :, None] * sides
    squares = (on_edges**2).sum(axis=2)
    best, every = squares.argmin(axis=1), np.arange(len(x))
    offset, place = on_edges[every, best], along[every, best]
    part = np.where(place <= 0, 4 + best, np.where(place >= 1, 4 + (best + 1) % 3, 1 + best))
    normal = np.cross(sides[:, 0], sides[:, 1])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    inward = np.cross(normal[:, None], sides)
    over = ((relative * inward).sum(axis=2) > 0).all(axis=1)
    height = (relative[:, 0] * normal).sum(axis=1)
    offset = np.where(over[:, None], height[:, None] * normal, offset)
    return offset, np.where(over, 0, part)
