"""Base class of load families, and their names in case files.

A case file names a shipped family, or a user's class as ``family: path/to/file.py:ClassName``; the
path is relative to the case file.
"""

from __future__ import annotations

import importlib
from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import (
    AfterValidator,
    Field,
    ValidationError,
)

from shared_schema.common.bodies.cells import outward_facets
from shared_schema.common.bodies.distributed_loads import nodal_volumes
from shared_schema.common.bodies.groups import GroupParts, cells_in, facets_in
from shared_schema.common.bodies.points_between import PointsBetween
from shared_schema.common.configuration import Frozen, absent, first_problem
from shared_schema.common.units import Magnitude
from shared_schema.loads.regions import Region
from shared_schema.own_class import import_named
from shared_schema.tools import Sphere

SHIPPED = {
    "random_node": "shared_schema.loads.forces_at_nodes:RandomNode",
    "random_nodes": "shared_schema.loads.forces_at_nodes:RandomNodes",
    "each_node": "shared_schema.loads.forces_at_nodes:EachNode",
    "given": "shared_schema.loads.forces_at_nodes:GivenLoads",
    "sweep": "shared_schema.loads.forces_at_nodes:Sweep",
    "traction": "shared_schema.loads.distributed_forces:Traction",
    "traction_patch": "shared_schema.loads.distributed_forces:TractionPatch",
    "body_force": "shared_schema.loads.distributed_forces:BodyForce",
    "pressure": "shared_schema.loads.distributed_forces:Pressure",
    "displacement": "shared_schema.loads.displacement_and_tool:Displacement",
    "tool": "shared_schema.loads.displacement_and_tool:ToolPress",
}


def ascending(value: tuple[float, float]) -> tuple[float, float]:
    """Return (low, high); ValueError unless low < high."""
    if value[0] >= value[1]:
        raise ValueError("expected [low, high] with low < high")
    return value


def numbers(value: tuple[int, int]) -> tuple[int, int]:
    """Return (fewest, most); ValueError unless 1 ≤ fewest ≤ most."""
    if not 1 <= value[0] <= value[1] <= 10**9:
        raise ValueError("expected [fewest, most] with 1 <= fewest <= most")
    return value


ForceRange = Annotated[tuple[Magnitude, Magnitude], AfterValidator(ascending)]
CountRange = Annotated[tuple[int, int], AfterValidator(numbers)]


@dataclass(frozen=True)
class LoadableNodes:
    """Nodes that a family may load, with the mesh that they belong to.

    Attributes
    ----------
    nodes : array of int, (n_loadable,)
        Numbers of the loadable nodes, ascending.
    coordinates : array, (n_nodes, d)
        Positions of all nodes of the mesh, in m.
    cells : array of int, (n_cells, n_corners)
        Node numbers of every cell of the mesh, in VTK order.
    cell_type : str
        meshio's name.
    region : array of int, (n_region,), optional
        Numbers of all nodes of the region, clamped ones included; by default `nodes`.
    clamped : array of int, (n_clamped,), optional
        Numbers of all nodes that do not move at all; by default there are none.
    points : PointsBetween, optional
        All points of the elements; by default the nodes are all.
    parts : GroupParts, optional
        Facets and cells of the group that the region names, if its nodes do not tell them.
    """

    nodes: NDArray[np.int64]
    coordinates: NDArray[np.float64]
    cells: NDArray[np.int64]
    cell_type: str
    region: NDArray[np.int64] | None = None
    clamped: NDArray[np.int64] | None = None
    points: PointsBetween | None = None
    parts: GroupParts | None = None

    def __len__(self) -> int:
        return len(self.nodes)

    @property
    def dimension(self) -> int:
        """Number of space dimensions d."""
        return int(self.coordinates.shape[1])

    @cached_property
    def surface(self) -> NDArray[np.int64]:
        """Facets of the whole surface, seen from outside."""
        return outward_facets(self.coordinates, self.cells, self.cell_type)

    @cached_property
    def facets(self) -> NDArray[np.int64]:
        """Facets of the surface whose nodes all lie in the region, seen from outside.

        If the region names a group of facets or cells, they belong to it.
        """
        return facets_in(self.surface, self._in_region, self.parts)

    @property
    def cells_inside(self) -> NDArray[np.bool_]:
        """Cells whose nodes all lie in the region, (n_cells,); of a group of cells, those of it."""
        inside = cells_in(self.cells, self._in_region, None)
        return inside & cells_in(self.cells, self._in_region, self.parts)

    @cached_property
    def volumes(self) -> NDArray[np.float64]:
        """∫ N_a dV over the cells of the region, for every point: (n_points,) in m³."""
        cells = (self.cells if self.points is None else self.points.cells)[self.cells_inside]
        return nodal_volumes(self.positions, cells)

    @property
    def _in_region(self) -> NDArray[np.bool_]:
        """Nodes of the region, clamped ones included, (n_nodes,)."""
        inside = np.zeros(len(self.coordinates), dtype=bool)
        inside[self.nodes if self.region is None else self.region] = True
        return inside

    @cached_property
    def positions(self) -> NDArray[np.float64]:
        """Positions of all points of the elements, (n_points, d) in m."""
        x = self.coordinates
        return x if self.points is None else self.points.interpolated(x)

    def all_points(self, facets: NDArray[np.int64]) -> NDArray[np.int64]:
        """Facets by the numbers of all their points, by those of their corners."""
        return facets if self.points is None else self.points.facets(facets)

    def under(self, forces: NDArray[np.float64]) -> LoadCase:
        """Load case of forces on all points, (n_points, d) in N, at the nodes of the region."""
        between = None
        if self.points is not None:
            forces, between = self.points.on_nodes(forces), forces[self.points.nodes :]
        return LoadCase(self.nodes, forces[self.nodes], between=between)

    def require_facets(self) -> None:
        """Raise ValueError unless every node of the region belongs to a facet of the region."""
        lonely = np.setdiff1d(self.nodes, self.facets)
        if lonely.size:
            at = ",".join(f"{x:g}" for x in self.coordinates[lonely[0]])
            raise ValueError(f"key 'region': the node at {at} belongs to no facet of the region")

    def require_components(self, key: str, vector: tuple[float, ...]) -> None:
        """Raise ValueError unless a vector of the case has d components."""
        if len(vector) != self.dimension:
            raise ValueError(f"key '{key}' = {vector}: expected {self.dimension} components")


@dataclass(frozen=True)
class LoadCase:
    """The load of one sample.

    Attributes
    ----------
    nodes : array of int, (n_loads,)
        Numbers of the loaded nodes, each once.
    forces : array, (n_loads, d)
        Force vector at each of them, in N.
    pressure : float, optional
        Pressure in Pa that follows the facets of the region, of a family that `presses`.
    displacement : array, (d,), optional
        Displacement in m of all nodes of the region, of a family that `moves` them.
    tool : Sphere, optional
        Rigid ball that the body keeps out of, of a family that `touches` it.
    between : array, (n_between, d), optional
        Forces between the nodes of quadratic elements in N
        (`shared_schema.common.bodies.points_between`); by default there are none, and
        the forces are those of points, the corners of cells.
    """

    nodes: NDArray[np.int64]
    forces: NDArray[np.float64]
    pressure: float | None = None
    displacement: NDArray[np.float64] | None = None
    tool: Sphere | None = None
    between: NDArray[np.float64] | None = None


class LoadFamily(Frozen, ABC):
    """A family of load cases; its attributes are the keys of a case's ``load`` section.

    Attributes
    ----------
    family : str
        Name of the family in the case file.
    region : Region
        Region of the loadable nodes, by default everywhere, without the clamped ones. None of a
        given region may be clamped, unless the family loads facets or cells (`integrates`).
    family_sha256 : str, optional
        Checksum of the file of a user's own family. It is filled in when a case is read, so that a
        dataset belongs to one version of the file.
    """

    integrates: ClassVar[bool] = False
    presses: ClassVar[bool] = False
    touches: ClassVar[bool] = False
    of_sides: ClassVar[bool] = False  # groups are of facets, where cells have the same name

    family: str
    region: Region = Region()
    family_sha256: str | None = Field(None, pattern=r"^[0-9a-f]{64}$", exclude_if=absent)

    @property
    def is_everywhere(self) -> bool:
        """True if the region is the one that a case need not name."""
        return bool(self.region == type(self).model_fields["region"].default)

    def check(self, loadable: LoadableNodes) -> None:
        """Raise ValueError, which names the key, if the family does not fit the mesh."""

    @property
    def acts_between(self) -> bool:
        """True if the loads act on the points between the nodes of quadratic elements as well."""
        return self.integrates

    def moves(self, dimension: int) -> tuple[bool, ...]:
        """Say which components of the region's displacement are prescribed; none of most loads."""
        return (False,) * dimension

    @abstractmethod
    def draw(self, number: int, seed: int, loadable: LoadableNodes) -> LoadCase:
        """Draw the load of one sample, as a pure function of the arguments.

        Parameters
        ----------
        number : int
            Sample number.
        seed : int
            Seed of the dataset.
        loadable : LoadableNodes
            Nodes of the region.
        """

    @abstractmethod
    def loads_per_sample(self, loadable: LoadableNodes) -> int:
        """Largest number of loaded nodes of a sample."""


def generator(seed: int, number: int) -> np.random.Generator:
    """Generator of a sample's random numbers: the same on every rank, restart and order of work."""
    return np.random.default_rng([seed, number])


def load_family(content: dict[str, Any], folder: Path | None = None) -> LoadFamily:
    """Build the family that the ``load`` section of a case names.

    Parameters
    ----------
    content : dict
        The section.
    folder : Path, optional
        Folder of the case file. Without one only shipped families are allowed, and nothing else is
        imported.

    Raises
    ------
    ValueError
        If there is no such family, its file cannot be imported or has another checksum, or one of
        the keys is wrong.
    """
    name = content.get("family")
    if not isinstance(name, str):
        raise ValueError(f"expected 'family', one of {', '.join(SHIPPED)} or FILE.py:ClassName")
    if name in SHIPPED:
        if content.get("family_sha256") is not None:
            raise ValueError(f"key 'family_sha256': load family '{name}' is no file")
        if folder is not None and isinstance(content.get("file"), str):
            content = {**content, "file": str(folder / content["file"])}
        place, _, class_name = SHIPPED[name].rpartition(":")
        family = getattr(importlib.import_module(place), class_name)
    else:
        family, digest = import_named("load family", name, tuple(SHIPPED), LoadFamily, folder)
        if content.get("family_sha256") not in (None, digest):
            raise ValueError(
                f"load family '{name}': key 'family_sha256' = {content['family_sha256']!r}, "
                f"the file has {digest}"
            )
        content = {**content, "family_sha256": digest}
    try:
        built: LoadFamily = family.model_validate(content, context=folder)
    except ValidationError as error:
        raise ValueError(f"{first_problem(error)} (load family '{name}')") from None
    return built
