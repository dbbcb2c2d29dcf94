"""The mesh and grid that a surrogate predicts on, carried in its run folder."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from numpy.typing import ArrayLike, NDArray
from torch import Tensor

from shared_schema.common.arguments import hold_read_only, read_only
from shared_schema.common.bodies.cells import boundary_facets, outward_facets
from shared_schema.common.bodies.command_loads import LoadedBody
from shared_schema.common.bodies.following_loads import FollowingLoad, PressedSurface
from shared_schema.common.bodies.groups import GroupParts, groups_of, parts_of
from shared_schema.common.bodies.points_between import PointsBetween
from shared_schema.common.errors import InputError
from shared_schema.common.units import SI, Units
from shared_schema.grid import Grid, grid_arrays, grid_of
from shared_schema.layout import Arrays

if TYPE_CHECKING:
    from shared_schema.actuators import PlacedActuators
    from shared_schema.common.bodies.shape_family import ShapeFamily

PREFIX = "geometry."
GROUP = "group:"  # before the name of a group of nodes
SIDES, INSIDE = "sides of:", "cells of:"  # before that of one whose nodes do not tell them
PARAMETER = "parameter:"  # before the number and name of a parameter of the shape
SURFACE = "surface"  # in place of the name of a group


@dataclass(frozen=True)
class Geometry:
    """Mesh, supports and grid of a case. Its arrays are read-only.

    Attributes
    ----------
    coordinates : array, (n_nodes, d)
        In m.
    cells : array of int, (n_cells, n_corners)
    cell_type : str
        meshio's name.
    clamped, loadable : array of bool, (n_nodes,)
        Nodes that do not move at all; nodes that the loads of the case may load.
    grid : Grid
    single : array of bool, (n_nodes, d), or None
        Components that are held, if some nodes are held in single ones.
    parts : array of int, (n_cells,), or None
        Position of each cell's material in the case, if it has several.
    groups : mapping of str to array of bool, (n_nodes,)
        Nodes of the named groups of the mesh.
    group_parts : mapping of str to GroupParts
        Facets and cells of the groups whose nodes do not tell them.
    fibres : array, (n_cells, families, d), or None
        Unit directions of the fibres of every cell, 0 where its material has fewer families.
    pressed : array of int, (n_facets, n_corners), or None
        Facets that a pressure of the case follows, seen from outside.
    pressed_surface : array of int, (n_facets,), or None
        Number of the surface that each of them belongs to; None in runs of earlier versions.
    mean_dilation : bool
        True if the volume of a cell changes as a whole, or that of quadratic triangles and
        tetrahedra linearly (`surrogate.mechanics.solids.mixed_elements`). Not among the arrays: the
        case says it (`surrogate.mechanics.body.elements_of_case`).
    has_points_between : bool
        True if the elements have points between the nodes, on which loads act as well.
    pressed_by_corners : bool
        True if pressures of the case act on facets that their corners span, though elements have
        points between these: so they do in datasets of earlier versions.
    units : Units
        Labels of the units of the case, which says them too.
    shapes : ShapeFamily or None
        Where the nodes are in other shapes, of a family of them.
    parameters : array, (n_parameters,), or None
        Those of this shape.
    actuators : PlacedActuators or None
        Cables and chambers, which the case says too.
    """

    coordinates: NDArray[np.float64]
    cells: NDArray[np.int64]
    cell_type: str
    clamped: NDArray[np.bool_]
    loadable: NDArray[np.bool_]
    grid: Grid
    single: NDArray[np.bool_] | None = None
    parts: NDArray[np.int64] | None = None
    groups: Mapping[str, NDArray[np.bool_]] = field(default_factory=dict)
    pressed: NDArray[np.int64] | None = None
    pressed_surface: NDArray[np.int64] | None = None
    mean_dilation: bool = False
    has_points_between: bool = False
    pressed_by_corners: bool = False
    units: Units = SI
    group_parts: Mapping[str, GroupParts] = field(default_factory=dict)
    fibres: NDArray[np.float64] | None = None
    shapes: ShapeFamily | None = None
    parameters: NDArray[np.float64] | None = None
    actuators: PlacedActuators | None = None

    def __post_init__(self) -> None:
        hold_read_only(self)

    @classmethod
    def from_arrays(cls, arrays: Arrays, cell_type: str) -> Geometry:
        """Take the geometry from the arrays of a structured shard."""
        shapes = None
        if "mesh/shape_terms" in arrays:
            from shared_schema.common.bodies.shape_family import ShapeFamily

            shapes = ShapeFamily.of_arrays(arrays)
        return cls(
            arrays["mesh/coordinates"],
            arrays["mesh/cells"],
            cell_type,
            arrays["mesh/clamped"],
            arrays["mesh/loadable"],
            grid_of(arrays),
            arrays.get("mesh/held"),
            arrays.get("mesh/material"),
            groups_of(arrays),
            arrays.get("mesh/pressed"),
            arrays.get("mesh/pressed_surface"),
            group_parts=parts_of(arrays, cell_type),
            fibres=arrays.get("mesh/fibres"),
            shapes=shapes,
            parameters=None if shapes is None else shapes.middle,
        )

    @classmethod
    def from_tensors(cls, tensors: dict[str, Tensor], cell_type: str) -> Geometry:
        """Take the geometry from the result of `tensors`."""
        arrays = {
            name.removeprefix(PREFIX): tensor.numpy()
            for name, tensor in tensors.items()
            if name.startswith(PREFIX)
        }
        groups = {k.removeprefix(GROUP): v for k, v in arrays.items() if k.startswith(GROUP)}
        shapes = None
        if "shape_terms" in arrays:
            from shared_schema.common.bodies.shape_family import ShapeFamily

            ranges = sorted((k, v) for k, v in arrays.items() if k.startswith(PARAMETER))
            names = tuple(key.split(":", 2)[2] for key, _ in ranges)
            ends = np.array([values for _, values in ranges])
            shapes = ShapeFamily(names, ends, arrays["shape_terms"])
        return cls(
            arrays["coordinates"],
            arrays["cells"],
            cell_type,
            arrays["clamped"],
            arrays["loadable"],
            grid_of(arrays),
            arrays.get("single"),
            arrays.get("parts"),
            groups,
            arrays.get("pressed"),
            arrays.get("pressed_surface"),
            group_parts={
                name: GroupParts(arrays[SIDES + name], arrays[INSIDE + name])
                for name in groups
                if SIDES + name in arrays
            },
            fibres=arrays.get("fibres"),
            shapes=shapes,
            parameters=arrays.get("parameters"),
        )

    def arrays(self) -> Arrays:
        """Arrays of mesh, supports, materials and grid map by name."""
        optional = {name: getattr(self, name) for name in _OPTIONAL}
        given = {name: array for name, array in optional.items() if array is not None}
        return {name: getattr(self, name) for name in _ARRAYS} | given | grid_arrays(self.grid)

    def tensors(self) -> dict[str, Tensor]:
        """The geometry as named tensors, for the weights file."""
        others: Arrays = {GROUP + name: members for name, members in self.groups.items()}
        for name, part in self.group_parts.items():
            others |= {SIDES + name: part.facets, INSIDE + name: part.cells}
        for name in ("pressed", "pressed_surface"):
            if (values := getattr(self, name)) is not None:
                others[name] = values
        if self.shapes is not None and self.parameters is not None:
            others["parameters"] = self.parameters
            ranges = zip(self.shapes.names, self.shapes.ranges, strict=True)
            others |= {f"{PARAMETER}{i}:{name}": r for i, (name, r) in enumerate(ranges)}
        return {
            PREFIX + name: torch.tensor(array)
            for name, array in (*self.arrays().items(), *others.items())
        }

    @property
    def shape_terms(self) -> NDArray[np.float64] | None:
        """Polynomial of the node positions of a family of shapes."""
        return None if self.shapes is None else self.shapes.terms

    def of_shape(self, parameters: Mapping[str, float]) -> Geometry:
        """The body with its nodes where they are in the shape of some parameters.

        Raises
        ------
        InputError
            If the body has one shape, there is no such parameter, or they tangle the mesh.
        """
        if self.shapes is None:
            name = next(iter(parameters), "")
            raise InputError(f"parameter {name}: the body has one shape", "parameter")
        return self.shaped(self.shapes.checked(parameters, self.cells, self.cell_type))

    def shaped(self, values: NDArray[np.float64]) -> Geometry:
        """The same, of checked parameters, (n_parameters,)."""
        assert self.shapes is not None
        x = self.shapes.coordinates(values)
        shape = replace(self, coordinates=x, parameters=values)
        placed = shape.actuators
        return shape if placed is None else replace(shape, actuators=placed.on(shape.positions))

    @property
    def positions(self) -> NDArray[np.float64]:
        """Positions of all points that loads act on, (n_points, d) in m."""
        points = self.loaded_points
        return self.coordinates if points is None else points.interpolated(self.coordinates)

    @property
    def shape(self) -> Tensor | None:
        """Parameters of the shape between −1 and 1 in their ranges, as inputs of networks, (n,)."""
        if self.shapes is None or self.parameters is None:
            return None
        return torch.from_numpy(self.shapes.scaled(self.parameters)).float()

    @property
    def dimension(self) -> int:
        """Number of space dimensions d."""
        return int(self.coordinates.shape[1])

    @property
    def held(self) -> NDArray[np.bool_]:
        """Components of displacement that are held at zero, (n_nodes, d)."""
        if self.single is not None:
            return self.single
        return np.repeat(self.clamped[:, None], self.dimension, axis=1)

    @property
    def free(self) -> NDArray[np.bool_]:
        """Components of displacement that are not held, (n_nodes, d)."""
        return ~self.held

    @property
    def surfaces(self) -> tuple[NDArray[np.int64], ...]:
        """Facets of every surface under a pressure of the case; one surface in earlier runs.

        With all points that pressures act on (`pressed_points`).
        """
        if self.pressed is None:
            return ()
        points = self.pressed_points
        facets = self.pressed if points is None else points.facets(self.pressed)
        if self.pressed_surface is None:
            return (facets,)
        of = self.pressed_surface
        return tuple(facets[of == number] for number in range(int(of.max()) + 1))

    @property
    def following(self) -> tuple[FollowingLoad, ...]:
        """Loads of the case that follow the body, of unit amplitude: `surfaces`, then actuators."""
        units = tuple(PressedSurface(facets) for facets in self.surfaces)
        return units if self.actuators is None else (*units, *self.actuators.loads)

    @property
    def cable_points(self) -> list[NDArray[np.int64]]:
        """Numbers of the points that each leg of a cable joins, (1, k) each."""
        units = () if self.actuators is None else self.actuators.loads
        return [points for unit in units for points in unit.joins]

    @cached_property
    def points_between(self) -> PointsBetween:
        """Points of quadratic elements on the mesh."""
        return PointsBetween.of(self.cells, self.cell_type, len(self.coordinates))

    @cached_property
    def free_at_points(self) -> NDArray[np.bool_]:
        """Components that are not held, at the nodes and then between them, (n_points, d).

        Between nodes, those that are held at all of them.
        """
        if not self.has_points_between:
            return read_only(self.free)
        return read_only(~self.points_between.held(self.held))

    @property
    def loaded_points(self) -> PointsBetween | None:
        """Points that loads act on; None if these are the nodes."""
        return self.points_between if self.has_points_between else None

    @property
    def pressed_points(self) -> PointsBetween | None:
        """Points that pressures of the case act on; None if these are the nodes."""
        return None if self.pressed_by_corners else self.loaded_points

    @property
    def no_pressure(self) -> NDArray[np.float64] | None:
        """Amplitudes where forces act alone: 0 of each of `following`; None without any."""
        return np.zeros(len(self.following)) if self.following else None

    @cached_property
    def surface_nodes(self) -> NDArray[np.int64]:
        """Numbers of the nodes of facets that belong to one cell."""
        return read_only(np.unique(boundary_facets(self.cells, self.cell_type)))

    @cached_property
    def surface_facets(self) -> NDArray[np.int64]:
        """Facets that belong to one cell, (n_facets, n_corners), seen from outside."""
        return read_only(outward_facets(self.coordinates, self.cells, self.cell_type))

    def nodes_of(self, nodes: str | ArrayLike) -> NDArray[np.int64]:
        """Numbers of the nodes of the surface ("surface"), of a named group, or those given.

        Raises
        ------
        InputError
            If there is no such group, or a number is none of a node or stands there twice.
        """
        count = len(self.coordinates)
        if isinstance(nodes, str):
            if nodes == SURFACE:
                return self.surface_nodes
            if nodes not in self.groups:
                known = ", ".join([SURFACE, *sorted(self.groups)])
                raise InputError(f"nodes '{nodes}': no such group, expected one of {known}")
            return np.flatnonzero(self.groups[nodes])
        numbers = np.asarray(nodes)
        if numbers.ndim != 1 or numbers.dtype.kind not in "iu":
            raise InputError("nodes: expected whole numbers in a row, or the name of a group")
        if len(numbers) and not 0 <= numbers.min() <= numbers.max() < count:
            raise InputError(f"nodes: expected numbers from 0 to {count - 1}")
        if len(np.unique(numbers)) < len(numbers):
            raise InputError("nodes: expected each number once")
        return numbers.astype(np.int64)

    @property
    def loaded_body(self) -> LoadedBody:
        """The body as loads of a command refer to it."""
        mesh = self.coordinates, self.cells, self.cell_type
        parts = self.group_parts
        return LoadedBody(*mesh, self.held, self.groups, self.loaded_points, parts)

    @property
    def movable(self) -> NDArray[np.bool_]:
        """Components at grid points that are not held, (d, nx, ny[, nz])."""
        return np.stack([self.grid.moved_by(free) for free in self.free.T])

    @property
    def free_mask(self) -> NDArray[np.bool_]:
        """Grid points whose displacement is that of nodes free to move, (nx, ny[, nz])."""
        return self.grid.moved_by(~self.clamped)

    @property
    def tip(self) -> int:
        """The loadable node farthest from the supports."""
        support = self.coordinates[self.held.any(axis=1)]
        candidates = np.flatnonzero(self.loadable)
        distance = np.linalg.norm(
            self.coordinates[candidates][:, None, :] - support[None, :, :], axis=2
        ).min(axis=1)
        return int(candidates[distance.argmax()])


_ARRAYS = ("coordinates", "cells", "clamped", "loadable")
_OPTIONAL = ("single", "parts", "fibres", "shape_terms")


def at_components(fields: Tensor, components: Tensor) -> Tensor:
    """Return some components of fields, by their numbers: (N, d, nx, ny[, nz]) → (N, n)."""
    return fields.flatten(1).index_select(1, components)


def by_component(free: NDArray[np.bool_], dimension: int) -> NDArray[np.bool_]:
    """Return the free components, (n_nodes, d); of a mask of nodes, (n_nodes,), all of theirs."""
    return free if free.ndim == 2 else np.repeat(free[:, None], dimension, axis=1)


def at_free(values: NDArray[Any], free: NDArray[np.bool_]) -> NDArray[Any]:
    """Return values of the free components of every sample, (M, n_nodes, d) → (M, …, …).

    Parameters
    ----------
    values : array, (M, n_nodes, d)
    free : array of bool, (n_nodes, d) or (n_nodes,)
        Components that are not held, or nodes.

    Returns
    -------
    array, (M, n_free_nodes, d) or (M, n_free_components, 1)
        By nodes if no node is held in single components only, else by components.
    """
    whole = free.all(axis=1) if free.ndim == 2 else free
    if free.ndim == 1 or np.array_equal(whole, free.any(axis=1)):
        return np.asarray(values[:, whole])
    return np.asarray(values[:, free][..., None])


def require_positive(std: NDArray[np.float64], free: NDArray[np.bool_]) -> None:
    """Raise ValueError unless σ, (M, n_nodes, d), is positive and finite where it is free."""
    wrong = ~(np.isfinite(std) & (std > 0)) & by_component(free, std.shape[-1])
    if np.any(wrong):
        first = tuple(int(index) for index in np.argwhere(wrong)[0])
        raise ValueError(
            f"std of (sample, node, component) {first} is {std[first]}, expected a positive number"
        )
