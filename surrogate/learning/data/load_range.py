"""What the load cases of a training had in common: numbers of loaded nodes, and resultants.

Where a case has pressures, all nodes of their surfaces are loaded in every sample. What then counts
is the number of other forces: those that no pressure there explains.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from shared_schema.common.bodies.distributed_loads import area_vectors
from shared_schema.common.configuration import Frozen

if TYPE_CHECKING:
    from surrogate.learning.data.dataset import Dataset
    from surrogate.mechanics.body.geometry import Geometry

Array = NDArray[np.float64]
ALONG = 1e-6  # of a force, the part across the normal that is rounding
BODY_FORCE = "body_force"
ONE_KIND = frozenset(  # families that draw one kind of load
    {
        *("body_force", "displacement", "each_node", "pressure", "random_node", "random_nodes"),
        *("sweep", "tool", "traction", "traction_patch"),
    }
)
AT_ONCE = 2**20  # grid points of all samples that are held at once


class LoadRange(Frozen):
    """Ranges over the training split.

    Attributes
    ----------
    fewest, most : int
        Smallest and largest number of loaded nodes of a sample.
    resultant : tuple of d floats
        Largest absolute component of the sum of a sample's forces, in N.
    """

    fewest: int
    most: int
    resultant: tuple[float, ...]


@dataclass(frozen=True)
class PressedNodes:
    """Nodes under pressures, and the number of nodes with other forces.

    Attributes
    ----------
    areas : array, (n_nodes, d)
        Area times normal that belongs to each node, in m²; zero at held components and elsewhere.
    others : float
        Largest number of nodes with other forces in a sample; infinite if it is not known.
    """

    areas: Array
    others: float

    @classmethod
    def of(cls, geometry: Geometry, case: Mapping[str, Any]) -> PressedNodes | None:
        """Take them from a body and the load families of its case; None without pressures."""
        if geometry.pressed is None:
            return None
        areas = area_vectors(geometry.coordinates, geometry.pressed)
        others = sum(_single_forces(family) for family in _families(case))
        return cls(np.where(geometry.held, 0.0, areas), others)

    def count_others(self, forces: Array, nodes: NDArray[np.int64]) -> NDArray[np.int64]:
        """Count the nodes whose force is not along the normal there.

        Parameters
        ----------
        forces : array, (N, n, d)
            In N, on some nodes; all others are free of forces.
        nodes : array of int, (n,)
            These nodes.

        Returns
        -------
        array of int, (N,)
        """
        areas = self.areas[nodes]
        squares = (areas**2).sum(axis=1)
        pressure = (forces * areas).sum(axis=2) / np.where(squares > 0, squares, 1.0)
        left = forces - pressure[..., None] * areas
        is_other = np.einsum("nid,nid->ni", left, left) > ALONG**2 * np.einsum(
            "nid,nid->ni", forces, forces
        )
        return np.count_nonzero(is_other, axis=1)


def known_families(case: Mapping[str, Any]) -> frozenset[str]:
    """Names of a case's load families; none if one of them may draw any kind of load."""
    names = frozenset(str(family.get("family")) for family in _families(case))
    return names if names <= ONE_KIND else frozenset()


def only_follows(case: Mapping[str, Any]) -> bool:
    """Whether the loads of a case are pressures and those of actuators alone."""
    names = {str(family.get("family")) for family in _families(case)}
    return names <= {"pressure"} and bool(names or case.get("actuators"))


def _families(case: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    families = case.get("load", ())
    return list(families) if isinstance(families, list | tuple) else [families]


def _single_forces(family: Mapping[str, Any]) -> float:
    """Largest number of nodes with forces of a load family; infinite if it is not known."""
    name = family.get("family")
    if name == "random_nodes":
        return float(family["count"][1])
    return {"pressure": 0.0, "random_node": 1.0, "each_node": 1.0, "sweep": 1.0}.get(
        str(name), float("inf")
    )


def load_range(dataset: Dataset) -> LoadRange:
    """Measure the training split of a dataset."""
    parts = [_measured(forces) for forces in _nodal_forces(dataset)]
    count = torch.cat([part[0] for part in parts])
    resultant = torch.cat([part[1] for part in parts])
    return LoadRange(
        fewest=int(count.min()),
        most=int(count.max()),
        resultant=tuple(resultant.abs().amax(dim=0).tolist()),
    )


def _nodal_forces(dataset: Dataset) -> Iterator[Tensor]:
    """Yield the forces of the training split, (n, d, n_nodes) each."""
    samples = max(1, AT_ONCE // dataset.geometry.grid.mask.size)
    for rows in torch.split(torch.arange(len(dataset.training)), samples):
        if dataset.geometry.grid.points_are_nodes:
            yield dataset.training[rows].force.flatten(2)
        else:
            yield torch.from_numpy(dataset.nodal_train(rows).force).transpose(1, 2)


def _measured(forces: Tensor) -> tuple[Tensor, Tensor]:
    """Numbers of loaded nodes, and resultants: (N, d, n_nodes) → (N,), (N, d)."""
    return (forces != 0).any(dim=1).sum(dim=1), forces.double().sum(dim=2)
