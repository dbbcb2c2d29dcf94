"""Warnings about forces unlike those of the training data."""

from __future__ import annotations

import logging
import warnings
from collections.abc import Collection, Iterator

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csr_array

from shared_schema.common.bodies.equilibrium import UNITS
from shared_schema.common.units import SI, Units
from shared_schema.grid import Grid
from surrogate.learning.data.load_range import BODY_FORCE, LoadRange, PressedNodes, known_families
from surrogate.learning.runs.description import RunDescription
from surrogate.mechanics.body.geometry import Geometry

logger = logging.getLogger(__name__)
ROUNDING = 1e-6  # of forces, which datasets hold in single precision
PREFIX = 1e3  # ratio of neighbouring units: N and kN
Array = NDArray[np.float64]


class OutsideTrainingWarning(UserWarning):
    """Forces are unlike those of the training data; the prediction may be arbitrarily wrong."""


class TrainingRange:
    """The forces of the training data.

    Parameters
    ----------
    limit : tuple of d floats
        Largest absolute force component at a node, in N.
    loadable : array of bool, (n_nodes,)
        Nodes that were loaded.
    loads : LoadRange or None
        Numbers of loaded nodes and resultants; None if the run does not have them.
    grid : Grid, optional
        Grid whose points `limit` is that of, if they are no nodes.
    pressed : PressedNodes, optional
        Nodes under the pressures of the training, whose number is no number of single forces.
    families : collection of str
        Names of the load families of the training; empty if these do not say what loads there are.
    units : Units
        Labels of the units of the forces.
    """

    def __init__(
        self,
        limit: tuple[float, ...],
        loadable: NDArray[np.bool_],
        loads: LoadRange | None,
        grid: Grid | None = None,
        pressed: PressedNodes | None = None,
        families: Collection[str] = (),
        units: Units = SI,
    ) -> None:
        self._pressed, self._unit = pressed, units.force
        self._to_grid = None if grid is None or grid.points_are_nodes else forces_to_grid(grid)
        self._limit = np.array(limit)
        self._largest = self._limit + ROUNDING * self._limit.max()
        self._families = families
        self._elsewhere = ~loadable
        self._loads = loads
        self._warned: set[str] = set()
        self._shape: list[str] = []

    @classmethod
    def of(cls, geometry: Geometry, description: RunDescription) -> TrainingRange:
        """That of a run."""
        data = description.data
        if not description.run.learns:
            return cls.none(geometry)
        loads = data.loads
        if loads is not None and data.case.get("actuators"):  # of which some may be slack
            loads = loads.model_copy(update={"fewest": 0})
        found = cls(
            data.info.force.max_abs,
            geometry.loadable,
            loads,
            geometry.grid,
            PressedNodes.of(geometry, data.case),
            known_families(data.case),
            data.units,
        )
        if geometry.shapes is not None and geometry.parameters is not None:
            found._shape = geometry.shapes.outside(geometry.parameters)
        return found

    @classmethod
    def none(cls, geometry: Geometry) -> TrainingRange:
        """That of a model without a training: no forces leave it."""
        nodes, d = geometry.coordinates.shape
        return cls((np.inf,) * d, np.ones(nodes, np.bool_), None)

    def exceeded(self, forces: Array, body_force: bool = False) -> dict[str, str]:
        """Say how loads leave the training data: kind, range, places, number, resultant.

        Parameters
        ----------
        forces : array, (n_nodes, d) or (N, n_nodes, d)
            Nodal forces in N. No force at all is nothing unusual.
        body_force : bool
            Whether they are those of a body force as well.
        """
        if body_force and (unlike := self._unlike_body_force):
            return {"kind": unlike}
        return dict(self._exceeded(forces.reshape(-1, *forces.shape[-2:])))

    @property
    def _unlike_body_force(self) -> str | None:
        """Say that no load of the training was a body force; None if one was, or may have been."""
        if not self._families or BODY_FORCE in self._families:
            return None
        return (
            "a body force is a kind of load that the training data have none of "
            f"({', '.join(sorted(self._families))})"
        )

    def compared(self, forces: Array, body_force: bool = False) -> str:
        """Compare the size of forces, not all zero, with the training; ask for units if far off.

        Without a training there is nothing to compare with, nor for another kind of load.

        Parameters
        ----------
        forces : array, (n_nodes, d)
            Nodal forces in N.
        body_force : bool
            Whether they are those of a body force as well.
        """
        if np.isinf(self._limit).all():
            return UNITS
        if body_force and (unlike := self._unlike_body_force):
            return unlike
        values = forces if self._to_grid is None else self._to_grid @ forces
        ratio = float(np.abs(values).max() / self._limit.max())
        text = f"the largest force component is {ratio:.3g} times that of the training data"
        is_far = not 1 / PREFIX < ratio < PREFIX
        return f"{text}; are the units consistent?" if is_far else text

    def warn(self, forces: Array) -> None:
        """Issue an `OutsideTrainingWarning` for every kind that has not been warned of yet."""
        for text in self._new(forces):
            warnings.warn(text, OutsideTrainingWarning, stacklevel=3)

    def log(self, forces: Array, body_force: bool = False) -> None:
        """Log a warning of every kind that there has been none of yet."""
        for text in self._new(forces, body_force):
            logger.warning(text)

    def _new(self, forces: Array, body_force: bool = False) -> list[str]:
        exceeded = self.exceeded(forces, body_force)
        new = [text for kind, text in exceeded.items() if kind not in self._warned]
        self._warned.update(exceeded)
        return new

    def _exceeded(self, forces: Array) -> Iterator[tuple[str, str]]:
        if self._shape:
            yield "shape", self._shape[0]
        some = np.flatnonzero(forces.any(axis=0) @ np.ones(forces.shape[2], np.bool_))
        at_some = forces.take(some, axis=1)  # most loads act on a few nodes
        values = at_some
        if self._to_grid is not None:  # rows of all loads beside one another
            loads, nodes, d = forces.shape
            rows = forces.swapaxes(0, 1).reshape(nodes, loads * d)
            values = (self._to_grid @ rows).reshape(self._to_grid.shape[0], loads, d)
        if (np.abs(values) > self._largest).any():
            limit = self._pm(self._limit)
            yield "range", f"force components reach beyond those of the training data ({limit})"
        if self._elsewhere[some].any():
            yield "places", "a loaded node was never loaded in the training data"
        if self._loads is None:
            return
        fewest, most = self._loads.fewest, self._loads.most
        several, loaded = len(forces) > 1, "loaded nodes"
        counts = np.count_nonzero(at_some.any(axis=2), axis=1) if several else [len(some)]
        if self._pressed is not None:
            most = int(min(self._pressed.others, most))
            fewest, loaded = 0, "nodes with other forces"
            counts = self._pressed.count_others(at_some, some)
        unusual = [n for n in counts if n and not fewest <= n <= most]
        if unusual and most == 0:
            yield "kind", "forces other than pressures, the only loads of the training data"
        elif unusual:
            numbers = f"{fewest}" if fewest == most else f"{fewest} to {most}"
            yield "number", f"number of {loaded} {unusual[0]}, {numbers} in the training data"
        resultant, limit_of_all = np.einsum("nid->nd", at_some), np.array(self._loads.resultant)
        rounding = ROUNDING * (limit_of_all + np.abs(at_some).sum(axis=(1, 2))[:, None])
        if (np.abs(resultant) > limit_of_all + rounding).any():
            none = limit_of_all.max() <= ROUNDING * self._limit.max()
            limit = "0" if none else self._pm(limit_of_all)
            yield "resultant", f"the resultant is beyond that of the training data ({limit})"

    def _pm(self, limit: Array) -> str:
        return f"±{', '.join(f'{value:.3g}' for value in limit)} {self._unit}"


def forces_to_grid(grid: Grid) -> csr_array:
    """Bᵀ, which takes forces to the points of an embedded grid: (n_grid_points, n_nodes)."""
    nodes, corners = grid.points.shape
    places = grid.points.ravel(), np.repeat(np.arange(nodes), corners)
    shape = int(np.prod(grid.shape)), nodes
    return coo_array((grid.point_weights.ravel(), places), shape).tocsr()
