"""A body as its case says it: mesh, supports, materials and loads, without an equation to solve."""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from datagen.cases.case import Case
from datagen.cases.rigid_motions import motion_problem
from datagen.discretisation.element import element_kind
from datagen.materials import fibres_of_cells
from datagen.mesh.overlap import split_warning
from shared_schema.common.bodies.cells import boundary_facets
from shared_schema.common.bodies.groups import RawMesh, group_arrays
from shared_schema.common.bodies.points_between import PointsBetween
from shared_schema.common.errors import InputError
from shared_schema.loads import LoadsTogether
from shared_schema.loads.together import nodes_of, placed_loads
from shared_schema.materials import locking_warning


@dataclass(frozen=True)
class PlacedBody:
    """Mesh of a case with its supports, materials and loads.

    Attributes
    ----------
    case : Case
    mesh : RawMesh
    held : array of bool, (n_nodes, d)
        Components of displacement that supports hold at zero, by node number.
    parts : array of int, (n_cells,), or None
        Position of each cell's material in the case, if it has several.
    fibres : array, (n_cells, families, d), or None
        Unit vectors of the fibres in each cell, 0 where its material has fewer families.
    loads : LoadsTogether
        The load cases, by their sample number.
    """

    case: Case
    mesh: RawMesh
    held: NDArray[np.bool_]
    parts: NDArray[np.int64] | None
    fibres: NDArray[np.float64] | None
    loads: LoadsTogether

    @property
    def clamped(self) -> NDArray[np.bool_]:
        """Nodes that do not move at all, (n_nodes,)."""
        return np.asarray(self.held.all(axis=1))

    @property
    def loadable(self) -> NDArray[np.bool_]:
        """Nodes that load families and actuators may load, (n_nodes,)."""
        loadable = np.zeros(len(self.held), dtype=bool)
        for part in self.loads.parts:
            loadable[self.surface if part.family.touches else part.loadable.nodes] = True
        return (loadable | self.loads.actuated) & ~self.clamped

    @property
    def forces(self) -> Literal["consistent"] | None:
        """What a manifest says of loads on the points of the elements (`shared_schema`)."""
        return None if self.loads.points is None else "consistent"

    @cached_property
    def surface(self) -> NDArray[np.int64]:
        """Nodes of the surface."""
        return np.unique(boundary_facets(self.mesh.cells, self.mesh.cell_type))

    def of_shape(self, values: NDArray[np.float64]) -> PlacedBody:
        """The body with its nodes where they are in the shape of some parameters, (n,).

        Supports, materials, directions of fibres and loadable nodes are those of the reference.
        """
        assert self.mesh.shapes is not None
        whole = {field.name: getattr(self.mesh, field.name) for field in fields(RawMesh)}
        mesh = RawMesh(**{**whole, "coordinates": self.mesh.shapes.coordinates(values)})
        loads = self.loads.on(mesh.coordinates)
        return PlacedBody(self.case, mesh, self.held, self.parts, self.fibres, loads)

    def warnings(self) -> list[str]:
        """What the numbers of this body are not good for."""
        locking = locking_warning(self.case.element, self.mesh.cell_type, self.case.material)
        return [said for said in (locking, split_warning(self.mesh.coordinates)) if said]

    def shard_arrays(self) -> dict[str, Any]:
        """Arrays of the mesh that every shard holds, by their paths in the schema."""
        mesh = self.mesh
        arrays: dict[str, Any] = {
            "mesh/coordinates": mesh.coordinates,
            "mesh/cells": mesh.cells,
            "mesh/clamped": self.clamped,
            "mesh/loadable": self.loadable,
        }
        if self.held.any(axis=1).sum() != self.clamped.sum():
            arrays["mesh/held"] = self.held
        if self.parts is not None:
            arrays["mesh/material"] = self.parts
        if self.fibres is not None:
            arrays["mesh/fibres"] = self.fibres
        if mesh.shapes is not None:
            arrays |= mesh.shapes.arrays()
        arrays |= group_arrays(mesh.node_sets, mesh.cells, mesh.cell_type, mesh.parts)
        surfaces = self.loads.pressed
        if surfaces:
            arrays["mesh/pressed"] = np.concatenate(surfaces)
            counts = [len(facets) for facets in surfaces]
            arrays["mesh/pressed_surface"] = np.repeat(np.arange(len(surfaces)), counts)
        return arrays


def placed(case: Case, mesh: RawMesh) -> PlacedBody:
    """Place the supports, materials and loads of a case on its mesh.

    Raises
    ------
    InputError
        If a region holds no node, a loadable node is clamped, a load family does not fit the mesh,
        a cell has no material, or a part of the mesh is not supported.
    """
    dimension = mesh.coordinates.shape[1]
    held = np.zeros(mesh.coordinates.shape, dtype=bool)
    try:
        parts = _material_of_cells(case, mesh)
        fibres = fibres_of_cells(case.material, parts, mesh)
        for number, support in enumerate(case.supports):
            components, key = support.holds(dimension), f"supports.{number}"
            if not components.any():
                raise InputError(f"key '{key}.components': the body is in the plane")
            held[nodes_of(key, support, mesh, of_sides=True)] |= components
        if problem := motion_problem(mesh, held):
            raise InputError(f"key 'supports': {problem}")
        points = points_of(case, mesh)
        loads = placed_loads(case.load, case.dataset.seed, mesh, held, points, case.actuators or {})
    except InputError as error:
        raise InputError(f"case '{case.name}': {error}") from None
    return PlacedBody(case, mesh, held, parts, fibres, loads)


def points_of(case: Case, mesh: RawMesh) -> PointsBetween | None:
    """All points of the elements of a case; None if the nodes of the mesh are all."""
    if element_kind(case.element, mesh.cell_type).corners_only:
        return None
    return PointsBetween.of(mesh.cells, mesh.cell_type, len(mesh.coordinates))


def _material_of_cells(case: Case, mesh: RawMesh) -> NDArray[np.int64] | None:
    """Position of each cell's material, (n_cells,); None if all are of one."""
    if not isinstance(case.material, tuple):
        return None
    parts = np.full(len(mesh.cells), -1, dtype=np.int64)
    for number, material in enumerate(case.materials):
        group = str(material.group)
        key = f"key 'material.{number}.group' = '{group}'"
        if group not in mesh.cell_groups:
            names = ", ".join(sorted(mesh.cell_groups))
            named = f"no such group of cells, but {names}" if names else "no groups of cells"
            raise InputError(f"{key}: the mesh has {named}")
        members = mesh.cell_groups[group]
        if (parts[members] >= 0).any():
            raise InputError(f"{key}: a cell of it belongs to another material's group as well")
        parts[members] = number
    if (parts < 0).any():
        at = ",".join(f"{x:g}" for x in mesh.coordinates[mesh.cells[parts.argmin()]].mean(axis=0))
        raise InputError(f"key 'material': {(parts < 0).sum()} cells have none, the first at {at}")
    return parts
