"""Loads on a page: a dragged force on a node or on a patch of the surface, and a body force."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from shared_schema.common.bodies.cell_volumes import nodal_volumes
from shared_schema.common.bodies.cells import boundary_facets
from shared_schema.common.bodies.surface_patches import SurfacePatches
from shared_schema.common.errors import InputError
from surrogate.data.geometry import Geometry
from surrogate.inference.surrogate import Surrogate

FINGER = 0.05  # of the diagonal and of the largest body force: patch where nothing else acts
Arrays = dict[str, NDArray[Any]]
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
    arrays : dict
        For patches ``patchStarts``, ``patchNodes`` and ``patchWeights``: nodes, with weights of
        sum 1, that a force about each node reaches. For a body force ``volumes``: what of the
        body belongs to each node, in m³.
    """

    radius: float
    largest: tuple[float, ...]
    density: tuple[float, ...] | None
    arrays: Arrays


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
    weights = [f for f in families if f["family"] == "body_force" and _is_everywhere(f)]
    if radius is None:
        radius = _radius(geometry, patches, alone=bool(weights) and len(weights) == len(families))
    arrays, largest = Arrays(), surrogate.description.data.info.force.max_abs
    density = _largest(weights) if weights else None
    if density is not None:
        arrays["volumes"] = nodal_volumes(geometry.coordinates, geometry.cells)
    if radius > 0:
        spread, areas = patches_of(geometry, radius)
        arrays |= {
            "patchStarts": spread.indptr.astype(np.int32),
            "patchNodes": spread.indices.astype(np.int32),
            "patchWeights": spread.data,
        }
        if patches:
            largest = (_largest(patches) * float(areas.mean()),) * d
        elif density is not None:
            largest = (FINGER * density * float(arrays["volumes"].sum()),) * d
    return PageLoads(radius, largest, None if density is None else (density,) * d, arrays)


def families_of(case: Mapping[str, Any]) -> Families:
    """Load families of a case; none if there is no case."""
    families = case.get("load", [])
    return list(families) if isinstance(families, list | tuple) else [families]


def patches_of(geometry: Geometry, radius: float) -> tuple[csr_array, NDArray[np.float64]]:
    """Nodes that a force about each node of the boundary reaches.

    Nodes elsewhere, and those about which no part of the boundary is in reach, bear it alone.

    Parameters
    ----------
    geometry : Geometry
    radius : float
        In m.

    Returns
    -------
    weights : csr_array, (n_nodes, n_nodes)
        Rows of sum 1.
    areas : array
        Sums of the weights of the patches themselves, in m².
    """
    x, facets = geometry.coordinates, boundary_facets(geometry.cells, geometry.cell_type)
    surface, on_boundary = SurfacePatches.of(x, facets), set(np.unique(facets))
    starts, columns, values, areas = [0], [], [], []
    for node in range(len(x)):
        weights = surface.weights(x[node], radius) if node in on_boundary else np.zeros(0)
        reached = np.flatnonzero(weights)
        if len(reached):
            areas.append(float(weights.sum()))
            columns.append(reached)
            values.append(weights[reached] / areas[-1])
        else:
            columns.append(np.array([node]))
            values.append(np.ones(1))
        starts.append(starts[-1] + len(columns[-1]))
    found = csr_array((np.concatenate(values), np.concatenate(columns), starts), (len(x), len(x)))
    return found, np.array(areas)


def rows_of_patches(arrays: Arrays) -> csr_array | None:
    """The patches in the arrays of a page; None if forces act on nodes."""
    if "patchStarts" not in arrays:
        return None
    count = len(arrays["patchStarts"]) - 1
    parts = arrays["patchWeights"], arrays["patchNodes"], arrays["patchStarts"]
    return csr_array(parts, shape=(count, count))


def _is_everywhere(family: Mapping[str, Any]) -> bool:
    """True if a family is not restricted to a region."""
    region = family.get("region") or {}
    return not any(region.values())


def _largest(families: Families) -> float:
    """Largest magnitude in the ranges of some families."""
    return max(abs(float(end)) for family in families for end in family["range"])


def _radius(geometry: Geometry, patches: Families, alone: bool) -> float:
    if patches:
        return float(np.mean([np.mean(family["radius"]) for family in patches]))
    if not alone:
        return 0.0
    return FINGER * float(np.linalg.norm(np.ptp(geometry.coordinates, axis=0)))
