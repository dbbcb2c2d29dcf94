"""Load cases drawn by a family, held against what a load case may be.

Every load case is drawn here and nowhere else, so that solver, dataset and figures get the same.
"""

from __future__ import annotations

import operator
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, TypeVar

import numpy as np

from shared_schema.common.bodies.nodal_forces import sum_per_node
from shared_schema.common.errors import InputError
from shared_schema.common.units import LARGEST_LENGTH, LARGEST_MAGNITUDE
from shared_schema.loads.family import LoadableNodes, LoadCase, LoadFamily
from shared_schema.own_class import described, source_of
from shared_schema.tools import Sphere

Result = TypeVar("Result")


@dataclass(frozen=True)
class DrawnLoads:
    """The load cases of a dataset by their sample number.

    Attributes
    ----------
    family : LoadFamily
    seed : int
        Seed of the dataset.
    loadable : LoadableNodes
        Nodes of the region.
    """

    family: LoadFamily
    seed: int
    loadable: LoadableNodes

    def check(self) -> None:
        """Check that the family fits the mesh, and the load case of the first sample.

        Raises
        ------
        InputError
            One line that names the family and what is wrong.
        """
        self._called("check", lambda: self.family.check(self.loadable))
        self[0]

    @cached_property
    def most(self) -> int:
        """Largest number of loaded nodes of a sample; InputError if the family says none."""
        loadable = self.loadable
        most: Any = self._called("loads_per_sample", lambda: self.family.loads_per_sample(loadable))
        try:
            count = operator.index(most)
        except TypeError:
            count = 0
        if isinstance(most, bool) or not 1 <= count <= len(loadable.coordinates):
            raise self._wrong(
                f"loads_per_sample returned {most!r:.80}, expected a number from 1 to the "
                f"{len(loadable.coordinates)} nodes of the mesh"
            )
        return count

    def __getitem__(self, number: int) -> LoadCase:
        """Draw the load of one sample; forces on one node are added.

        Parameters
        ----------
        number : int
            Sample number.

        Raises
        ------
        InputError
            If the family raises an error, or what it draws is no load case: nodes of the region
            (int), at most `most` different ones, with a finite force vector each.
        """
        what, loadable = f"sample {number}", self.loadable
        load: Any = self._called(
            f"{what}: draw", lambda: self.family.draw(number, self.seed, loadable)
        )
        if not isinstance(load, LoadCase):
            raise self._wrong(f"{what}: draw returned {load!r:.80}, expected a LoadCase")
        try:
            nodes, forces = np.asarray(load.nodes), np.asarray(load.forces)
        except ValueError as error:
            raise self._wrong(f"{what}: no array ({error})") from None
        if nodes.ndim != 1 or (nodes.dtype.kind not in "iu" and nodes.size):
            found = f"type {nodes.dtype} and shape {nodes.shape}"
            raise self._wrong(f"{what}: nodes have {found}, expected int and (n_loads,)")
        nodes = nodes.astype(np.int64)
        outside = nodes[~np.isin(nodes, loadable.nodes)]
        if outside.size:
            raise self._wrong(
                f"{what}: node {outside[0]} is loaded, "
                f"expected some of the {len(loadable)} nodes of the region"
            )
        shape = (len(nodes), loadable.dimension)
        if forces.shape != shape or forces.dtype.kind not in "fiu":
            found = f"type {forces.dtype} and shape {forces.shape}"
            raise self._wrong(f"{what}: forces have {found}, expected float and {shape}")
        forces = forces.astype(np.float64)
        wrong = forces[~(np.abs(forces) <= LARGEST_MAGNITUDE)]  # a NaN as well
        if wrong.size:
            raise self._wrong(
                f"{what}: a force component is {wrong[0]:g} N, "
                f"expected at most {LARGEST_MAGNITUDE:g} N in magnitude"
            )
        self._require_driven_as_said(load, what)
        self._require_between(load, what)
        nodes, forces = sum_per_node(nodes, forces)
        if len(nodes) > self.most:
            raise self._wrong(
                f"{what}: {len(nodes)} nodes are loaded, expected at most {self.most} "
                "(loads_per_sample)"
            )
        return replace(load, nodes=nodes, forces=forces)

    def _require_between(self, load: LoadCase, what: str) -> None:
        """Raise InputError unless forces between the nodes are finite and on the points there."""
        if load.between is None:
            return
        points, found = self.loadable.points, np.asarray(load.between)
        if not self.family.acts_between:
            raise self._wrong(f"{what}: forces between the nodes, expected none (integrates)")
        shape = (0 if points is None else points.between, self.loadable.dimension)
        if found.shape != shape or not np.all(np.abs(found) <= LARGEST_MAGNITUDE):
            raise self._wrong(
                f"{what}: forces between the nodes have shape {found.shape}, expected {shape} and "
                f"finite numbers of at most {LARGEST_MAGNITUDE:g} N"
            )

    def _require_driven_as_said(self, load: LoadCase, what: str) -> None:
        """Raise InputError unless pressure, displacement and tool are those of such a family."""
        d, presses = self.loadable.dimension, self.family.presses
        moves = self._called("moves", lambda: self.family.moves(d))
        for name, value, expected, largest in (
            ("pressure", load.pressure, () if presses else None, LARGEST_MAGNITUDE),
            ("displacement", load.displacement, (d,) if any(moves) else None, LARGEST_LENGTH),
        ):
            if (value is None) != (expected is None) or (
                value is not None
                and not (
                    np.shape(value) == expected
                    and np.asarray(value).dtype.kind in "fiu"
                    and np.all(np.abs(value) <= largest)
                )
            ):
                said = "none" if expected is None else f"finite numbers of shape {expected}"
                raise self._wrong(f"{what}: {name} is {value!r:.80}, expected {said}")
        if isinstance(load.tool, Sphere) != self.family.touches:
            said = "a sphere" if self.family.touches else "none"
            raise self._wrong(f"{what}: tool is {load.tool!r:.80}, expected {said}")

    def _called(self, what: str, call: Callable[[], Result]) -> Result:
        """Result of the family's method; InputError if it raises an error."""
        try:
            return call()
        except MemoryError:
            raise
        except (Exception, SystemExit) as error:
            if isinstance(error, ValueError) and what == "check":  # what its contract asks for
                raise self._wrong(str(error)) from None
            said = described(error, source_of(self.family))
            raise self._wrong(f"{what}: {said}") from None

    def _wrong(self, problem: str) -> InputError:
        return InputError(f"load family '{self.family.family}': {problem}")
