r"""Loads that follow a body which may be distributed over ranks: pressures and cables.

.. math:: f_p(u) = \sum_j a_j \, g_j(X + u)

The unit forces g_j and their derivatives, which the tangent of the body lacks, are those of
`shared_schema.common.bodies.following_loads`. Given amplitudes a_j grow with the load factor; the
others are unknowns of their own (`datagen.solver.bordered_newton`), such as the pressure in a
chamber of given volume (`shared_schema.actuators.control`).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc

from shared_schema.actuators import Control, pressed
from shared_schema.common.bodies.following_loads import FollowingLoad, PressedSurface

if TYPE_CHECKING:
    from datagen.solver.equilibrium import EquilibriumProblem

Array = NDArray[np.float64]


class FollowingLoads:
    """Pressures and cables of a body; every rank has all of them, and adds to its own rows.

    Parameters
    ----------
    coordinates : array, (n_points, d)
        Undeformed positions of the points of the elements in m, the same on every rank.
    loads : sequence of FollowingLoad
    rows, columns : array of int, (n_points, d)
        Rows of the matrix, and its columns, of every point; -1 where they are not to be changed.

    Attributes
    ----------
    loads : tuple of FollowingLoad
    controls : tuple of Control
        What is given of each load.
    found : array, (n_loads,)
        Amplitudes, in Pa or N, of those that are not given; 0 else.
    """

    def __init__(
        self,
        coordinates: Array,
        loads: Sequence[FollowingLoad],
        rows: NDArray[np.int32],
        columns: NDArray[np.int32],
    ) -> None:
        self._coordinates, self.loads = coordinates, tuple(loads)
        self._rows, self._columns = rows, columns
        self.control(())

    def control(self, controls: Sequence[Control]) -> None:
        """Set what is given of each load; nothing acts if there is none."""
        self.controls = tuple(controls) or pressed(np.zeros(len(self.loads)))
        self.found = np.zeros(len(self.loads))

    @property
    def unknown(self) -> list[int]:
        """Numbers of the loads whose amplitude is not given."""
        return [i for i, control in enumerate(self.controls) if not control.gives_amplitude]

    @property
    def acts(self) -> bool:
        """True if an amplitude is given, or to be found."""
        return any(not c.gives_amplitude or c.value != 0.0 for c in self.controls)

    def amplitudes(self, load_factor: float) -> Array:
        """Present amplitudes in Pa or N: (n_loads,)."""
        given = [c.target(load_factor) if c.gives_amplitude else 0.0 for c in self.controls]
        return np.array(given) + self.found

    def quantities(self, u: Array) -> Array:
        """Volumes in m³ and lengths in m, (n_loads,), at a displacement (n_points, d) in m."""
        return np.array([load.quantity(self._coordinates + u) for load in self.loads])

    def unit_forces(self, number: int, u: Array) -> Array:
        """Forces of one load of amplitude 1: (n_points, d)."""
        return self.loads[number].forces(self._coordinates + u)

    def forces(self, u: Array, load_factor: float) -> Array:
        """Forces at a displacement in m: (n_points, d) in N."""
        return self._sum(u, self.amplitudes(load_factor))

    def norm_of_unknown(self, u: Array) -> float:
        """2-norm of the forces of amplitudes that are not given, in N."""
        return float(np.linalg.norm(self._sum(u, self.found)))

    def _sum(self, u: Array, amplitudes: Array) -> Array:
        total = np.zeros(u.shape)
        for load, amplitude in zip(self.loads, amplitudes, strict=True):
            if amplitude:
                total += amplitude * load.forces(self._coordinates + u)
        return total

    def coupled(self, u: Array) -> Iterator[NDArray[np.int64]]:
        """Yield points that the tangents couple, beyond those of one facet."""
        for load in self.loads:
            if not isinstance(load, PressedSurface):
                for points, _ in load.tangents(self._coordinates + u):
                    yield from points

    def add_tangent(self, matrix: PETSc.Mat, u: Array, load_factor: float) -> None:
        """Add −∂f_p/∂u to the matrix (collective)."""
        for load, amplitude in zip(self.loads, self.amplitudes(load_factor), strict=True):
            if not amplitude:
                continue
            for points, blocks in load.tangents(self._coordinates + u):
                for some, block in zip(points, amplitude * blocks, strict=True):
                    rows, columns = self._rows[some].ravel(), self._columns[some].ravel()
                    matrix.setValues(rows, columns, block, addv=PETSc.InsertMode.ADD_VALUES)
        matrix.assemble()


def found_actuation(problem: EquilibriumProblem, actuators: int) -> Array | None:
    """Amplitude and quantity of each actuator, the last loads, at the present state (collective).

    They are (n_actuators, 2), tensions in N with lengths in m, or pressures in Pa with volumes in
    m³; None if there are no actuators.
    """
    following = problem.load.following
    if following is None or not actuators:
        return None
    u = problem.displacement_of_points()
    values = following.amplitudes(problem.load_factor), following.quantities(u)
    return np.stack(values, axis=1)[-actuators:]
