"""A body that can be held and pushed, and the loads beside that."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from shared_schema.common.bodies.command_loads import CommandLoads
from surrogate.data.geometry import Geometry
from surrogate.descent.driven_body import DrivenBody
from surrogate.mechanics.out_of_balance import Equilibrium

Array = NDArray[np.float64]
BY_FACTORY = "`datagen solve` has them for all"
Predict: TypeAlias = Callable[[Array], Array]


class Body(Protocol):
    """What can be held and pushed, such as a `Surrogate`."""

    geometry: Geometry

    @property
    def equilibrium(self) -> Equilibrium:
        """The equilibrium of the body."""

    @property
    def driven_body(self) -> DrivenBody:
        """The body as directions see it."""

    @property
    def has_series(self) -> bool:
        """Whether predictions are those of a load series, which leave little to correct."""

    def require_nodes_alone(self, what: str, instead: str) -> None:
        """Raise InputError if elements have points between the nodes; say what is there instead."""

    def predict(self, forces: Any, *, tolerance: Any = None, pressure: Any = None) -> Any:
        """Nodal forces in N to displacements in m, both (n_nodes, d)."""


def load_beside(geometry: Geometry, load: Array | None) -> Array:
    """Load in N beside the forces of grips or tools, which may say what acts between the nodes.

    (n_nodes or n_points, d); InputError if it is wrong.
    """
    if load is None:
        return np.zeros(geometry.coordinates.shape)
    points, nodes, load = geometry.loaded_points, len(geometry.coordinates), np.asarray(load)
    between = load[nodes:] if points is not None and len(load) == points.count else load[:0]
    given = CommandLoads(geometry.loaded_body)
    given.add_forces(load[: len(load) - len(between)])
    return np.concatenate([given.forces, between])


def together_with(load: Array, force: Array) -> Array:
    """A load with nodal forces beside it, (n_nodes, d), in N."""
    total = load.copy()
    total[: len(force)] += force
    return total
