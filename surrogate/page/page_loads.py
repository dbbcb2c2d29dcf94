"""Loads on a page: a dragged force on a node or on a patch of the surface, and a body force."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csr_array, vstack

from shared_schema.common.bodies.cells import boundary_facets
from shared_schema.common.bodies.distributed_loads import SurfacePatches, nodal_volumes
from shared_schema.common.errors import InputError
from surrogate.learning.data.case_loads import families_of, region_of
from surrogate.learning.inference.surrogate import Surrogate
from surrogate.mechanics.body.geometry import Geometry
from surrogate.mechanics.statics.body import Body
from surrogate.page.body import sparse_rows

FINGER = 0.05  # of the diagonal and of the largest body force: patch where nothing else acts
MOVED = 0.1  # of the body's diagonal, under the largest force
Arrays = dict[str, NDArray[Any]]
Integers = NDArray[np.int64]
Families = list[Mapping[str, Any]]


@dataclass(frozen=True)
class PageLoads:
    """What loads a page offers.

    Attributes
    ----------
    radius : float
        Radius in m of the patch that a dragged force is spread over; 0 for a force on a node.
    largest : tuple of d floats
        Largest components of a dragged force in N, which set the length of arrows.
    density : tuple of d floats or None
        Largest components of the body force in N/m³; None if the case has no body force.
    """

    radius: float
    largest: tuple[float, ...]
    density: tuple[float, ...] | None


def page_loads(surrogate: Surrogate, radius: float | None = None) -> PageLoads:
    """Take the loads of a page from those of the case.

    Parameters
    ----------
    surrogate : Surrogate
    radius : float, optional
        Radius in m of patches. By default it is the mean of those of the case; a twentieth of the
        body's diagonal if the case has body forces alone; else 0.

    Raises
    ------
    InputError
        If the radius is negative or not finite.
    """
    if radius is not None and not 0 <= radius < np.inf:
        raise InputError(f"--patch {radius:g}: expected a finite radius in m, or 0")
    geometry, families = surrogate.geometry, families_of(surrogate.description.data.case)
    d = geometry.dimension
    patches = [f for f in families if f["family"] == "traction_patch"]
    weights = [f for f in families if f["family"] == "body_force" and not region_of(f)]
    if radius is None:
        radius = _radius(geometry, patches, alone=bool(weights) and len(weights) == len(families))
    largest = surrogate.description.data.info.force.max_abs
    if not families and geometry.actuators is not None:
        largest = (largest_force(surrogate.body),) * d
    density = _largest(weights) if weights else None
    if radius > 0 and patches:
        area = np.pi * radius**2 / 3 if d == 3 else 16 * radius / 15  # ∫ (1 − r²/R²)² dS
        largest = (_largest(patches) * area,) * d
    elif radius > 0 and density is not None:
        largest = (FINGER * density * float(volumes_of(geometry).sum()),) * d
    return PageLoads(radius, largest, None if density is None else (density,) * d)


def load_arrays(geometry: Geometry, loads: PageLoads, nodes: Integers) -> Arrays:
    """What loads on a page act on, for nodes that can be touched.

    Returns
    -------
    dict
        For patches ``patches/starts``, ``…/nodes`` and ``…/weights``, rows by node number of the
        nodes, with weights of sum 1, that a force about each of `nodes` reaches. For a body force
        ``volumes``, what of the body belongs to each node, in m³.
    """
    found = {} if loads.density is None else {"volumes": volumes_of(geometry)}
    if loads.radius > 0:
        rows = patches_of(geometry, loads.radius, nodes).tocoo()
        count = len(geometry.coordinates)
        placed = csr_array((rows.data, (nodes[rows.row], rows.col)), shape=(count, count))
        found |= {f"patches/{name}": array for name, array in sparse_rows(placed).items()}
    return found


def largest_force(body: Body) -> float:
    """Force in N at the tip under which the linear body moves by `MOVED` of its diagonal."""
    x, equilibrium = body.geometry.coordinates, body.equilibrium
    d, tip = x.shape[1], body.geometry.tip
    units = np.zeros((d, equilibrium.free.shape[0], d))
    units[range(d), tip, range(d)] = 1.0
    moved = np.linalg.norm(equilibrium.linear_response(units)[:, tip], axis=1).max()
    return float(MOVED * np.linalg.norm(np.ptp(x, axis=0)) / moved)


def volumes_of(geometry: Geometry) -> NDArray[np.float64]:
    """What of the body belongs to each node, (n_nodes,) in m³."""
    return nodal_volumes(geometry.coordinates, geometry.cells)


def patches_of(geometry: Geometry, radius: float, nodes: Integers) -> csr_array:
    """Weights of the nodes that forces about some nodes reach: (n, n_nodes), rows of sum 1.

    Nodes inside the body, and those about which no part of the boundary is in reach, bear a force
    alone. A radius of 0 m is that of a force on the node.

    Parameters
    ----------
    geometry : Geometry
    radius : float
        In m.
    nodes : array of int, (n,)
    """
    x, facets = geometry.coordinates, boundary_facets(geometry.cells, geometry.cell_type)
    surface = SurfacePatches.of(x, facets)
    spread = np.isin(nodes, facets) & (radius > 0)
    rows = []
    for node, is_spread in zip(nodes, spread, strict=True):
        row = surface.weights(x[node], radius) if is_spread else np.zeros(len(x))
        if not row.any():
            row[node] = 1.0
        rows.append(coo_array(row[None] / row.sum()))
    return csr_array(vstack(rows))


def _largest(families: Families) -> float:
    """Largest magnitude in the ranges of some families."""
    return max(abs(float(end)) for family in families for end in family["range"])


def _radius(geometry: Geometry, patches: Families, alone: bool) -> float:
    if patches:
        return float(np.mean([np.mean(family["radius"]) for family in patches]))
    if not alone:
        return 0.0
    return FINGER * float(np.linalg.norm(np.ptp(geometry.coordinates, axis=0)))
