r"""Families of random distributed forces, as consistent ones: tractions, body forces, pressures.

A uniform traction on a patch of the boundary has the forces

.. math:: f_a = \int_{Γ} N_a \, \bar t \, dS

on points a, in N, with the shape functions N_a of the facets of the patch Γ (Deshpande et al. 2022,
Eq. VWP, second term); a smooth patch about a random place

.. math:: t(x) = \bar t \, \Big(1 - \frac{|x - c|^2}{R^2}\Big)^2 \text{ for } |x - c| < R,
   \text{ else } 0, \qquad f_a = \int_{Γ} N_a \, t \, dS

with the centre c at a random node of the region and Γ the boundary facets whose nodes all lie in
the region (`shared_schema.common.bodies.distributed_loads`); and a uniform body force, such as
gravity in a random direction,

.. math:: f_a = \int_{Ω} N_a \, dV \; b

with the force density b in N per m³ of the undeformed body. What would act on clamped nodes is
borne by the supports. In two dimensions the body is 1 m thick.

A pressure acts against the outward normal of the deformed surface, and its forces grow with its
area. A dataset holds as nodal forces those that the same pressure has on the undeformed body.
"""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, field_validator

from shared_schema.common.bodies.cells import boundary_facets
from shared_schema.common.bodies.distributed_loads import SurfacePatches, facet_shares
from shared_schema.common.bodies.groups import facets_in
from shared_schema.common.units import Size
from shared_schema.loads.family import (
    CountRange,
    ForceRange,
    LoadableNodes,
    LoadCase,
    LoadFamily,
    ascending,
    generator,
)
from shared_schema.loads.regions import Region


class Traction(LoadFamily):
    """A uniform dead traction on the boundary facets whose nodes all lie in the region.

    Of a group of facets or cells, these facets belong to it.

    Attributes
    ----------
    region : Region
        The whole surface by default.
    range : tuple of 2 floats
        (low, high) of each component of the traction, in Pa.
    """

    integrates: ClassVar[bool] = True
    of_sides: ClassVar[bool] = True

    region: Region = Region(boundary=True)
    range: ForceRange

    def check(self, loadable: LoadableNodes) -> None:
        """Raise ValueError unless every node of the region belongs to a facet of the region."""
        loadable.require_facets()

    def draw(self, number: int, seed: int, loadable: LoadableNodes) -> LoadCase:
        """Draw the traction and convert it to forces."""
        traction = generator(seed, number).uniform(*self.range, size=loadable.dimension)
        return loadable.under(np.outer(point_areas(loadable), traction))

    def loads_per_sample(self, loadable: LoadableNodes) -> int:
        """Number of loaded nodes: all nodes of the region that are not clamped."""
        return len(loadable)


def point_areas(loadable: LoadableNodes) -> NDArray[np.float64]:
    """Integrate N_a over the facets of the region, for every point: (n_points,) in m²."""
    x, facets = loadable.positions, loadable.all_points(loadable.facets)
    areas = np.zeros(len(x))
    np.add.at(areas, facets, facet_shares(x[facets]))
    return areas


Array = NDArray[np.float64]


class TractionPatch(LoadFamily):
    """Dead tractions that fall smoothly from their centres to zero at some radius.

    Attributes
    ----------
    region : Region
        The whole surface by default.
    range : tuple of 2 floats
        (low, high) of each component of the largest traction, in Pa.
    radius : float or tuple of 2 floats
        R in m, or (low, high) that the R of every patch is drawn from.
    count : tuple of 2 ints
        Smallest and largest number of patches of a sample; the number is drawn uniformly.
    """

    of_sides: ClassVar[bool] = True

    region: Region = Region(boundary=True)
    range: ForceRange
    radius: Size | tuple[Size, Size]
    count: CountRange = Field((1, 1), exclude_if=lambda count: count == (1, 1))

    @field_validator("radius")
    @classmethod
    def _ascends(cls, value: float | tuple[float, float]) -> float | tuple[float, float]:
        return ascending(value) if isinstance(value, tuple) else value

    @property
    def acts_between(self) -> bool:
        """True: patches are integrated over facets."""
        return True

    @property
    def radii(self) -> tuple[float, float]:
        """Smallest and largest radius, in m."""
        return self.radius if isinstance(self.radius, tuple) else (self.radius, self.radius)

    def check(self, loadable: LoadableNodes) -> None:
        """Raise ValueError unless a patch about any node of the region bears a force."""
        surface = surface_of(loadable)
        for centre in loadable.coordinates[loadable.nodes]:
            if not surface.weights(centre, self.radii[0]).any():
                at = ",".join(f"{x:g}" for x in centre)
                raise ValueError(
                    f"key 'radius' = {self.radius}: a patch about the node at {at} reaches no "
                    "quadrature point of a facet of the region"
                )

    def draw(self, number: int, seed: int, loadable: LoadableNodes) -> LoadCase:
        """Draw the number of patches; of each its centre, traction and radius; and add them."""
        random, surface = generator(seed, number), surface_of(loadable)
        (fewest, most), (smallest, largest) = self.count, self.radii
        patches = fewest if fewest == most else int(random.integers(fewest, most + 1))
        forces = np.zeros(loadable.positions.shape)
        for _ in range(patches):
            centre = loadable.coordinates[loadable.nodes[random.integers(len(loadable))]]
            traction = random.uniform(*self.range, size=loadable.dimension)
            radius = smallest if smallest == largest else random.uniform(smallest, largest)
            forces += np.outer(surface.weights(centre, radius), traction)
        load = loadable.under(forces)
        loaded = load.forces.any(axis=1)
        return replace(load, nodes=load.nodes[loaded], forces=load.forces[loaded])

    def loads_per_sample(self, loadable: LoadableNodes) -> int:
        """Most nodes that as many of the largest patches, about any nodes of the region, can load.

        They are no more than the nodes of the region.
        """
        surface, centres = surface_of(loadable), loadable.coordinates[loadable.nodes]
        reached = (loadable.under(surface.weights(c, self.radii[1])[:, None]) for c in centres)
        under = max(int(np.count_nonzero(load.forces)) for load in reached)
        nodes = np.unique(surface.facets)
        return min(self.count[1] * under, int((nodes < len(loadable.coordinates)).sum()))


def surface_of(loadable: LoadableNodes) -> SurfacePatches:
    """Find the boundary facets of the region whose nodes are all loadable."""
    facets = boundary_facets(loadable.cells, loadable.cell_type)
    free = np.zeros(len(loadable.coordinates), dtype=bool)
    free[loadable.nodes] = True
    facets = loadable.all_points(facets_in(facets, free, loadable.parts))
    return SurfacePatches.of(loadable.positions, facets)


class BodyForce(LoadFamily):
    """A uniform force density on all cells whose nodes all lie in the region.

    Attributes
    ----------
    range : tuple of 2 floats
        (low, high) of each component of b, in N/m³; water has a weight of 9810 N/m³.
    """

    integrates: ClassVar[bool] = True

    range: ForceRange

    def check(self, loadable: LoadableNodes) -> None:
        """Raise ValueError unless every node of the region belongs to a cell of the region."""
        lonely = np.setdiff1d(loadable.nodes, loadable.cells[loadable.cells_inside])
        if lonely.size:
            raise ValueError("key 'region': a node of it belongs to no cell of the region")

    def draw(self, number: int, seed: int, loadable: LoadableNodes) -> LoadCase:
        """Draw the force density and convert it to forces."""
        density = generator(seed, number).uniform(*self.range, size=loadable.dimension)
        return loadable.under(np.outer(loadable.volumes, density))

    def loads_per_sample(self, loadable: LoadableNodes) -> int:
        """Number of loaded nodes: all nodes of the region that are not clamped."""
        return len(loadable)


class Pressure(LoadFamily):
    """A uniform pressure on the boundary facets whose nodes all lie in the region.

    Of a group of facets or cells, these facets belong to it.

    Attributes
    ----------
    region : Region
        The whole surface by default.
    range : tuple of 2 floats
        (low, high) of the pressure in Pa; positive ones push into the body.
    """

    integrates: ClassVar[bool] = True
    of_sides: ClassVar[bool] = True
    presses: ClassVar[bool] = True

    region: Region = Region(boundary=True)
    range: ForceRange

    def check(self, loadable: LoadableNodes) -> None:
        """Raise ValueError unless every node of the region belongs to a facet of the region."""
        loadable.require_facets()

    def draw(self, number: int, seed: int, loadable: LoadableNodes) -> LoadCase:
        """Draw the pressure."""
        pressure = float(generator(seed, number).uniform(*self.range))
        nothing = np.empty(0, dtype=np.int64), np.empty((0, loadable.dimension))
        return LoadCase(*nothing, pressure=pressure)

    def loads_per_sample(self, loadable: LoadableNodes) -> int:
        """Number of nodes under pressure that are not clamped."""
        return len(loadable)
