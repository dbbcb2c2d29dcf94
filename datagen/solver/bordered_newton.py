r"""Newton's method for a displacement and a few more unknowns: amplitudes, or the load factor.

.. math:: R(u, a) = 0, \qquad h(a, q(u)) = 0

with the unknowns a of some loads, :math:`∂R/∂a_j = -g_j`, and as many equations of the quantities
that they work on, :math:`∂q_j/∂u = ± g_j^T`. A step eliminates the displacement (*block
elimination*): with :math:`y = K^{-1} R` and :math:`W = K^{-1} G`,

.. math::
    \Big(\frac{∂h}{∂a} ± \frac{∂h}{∂q} \, G^T W\Big) δa = -h ± \frac{∂h}{∂q} \, G^T y, \qquad
    δu = -y + W \, δa.

K is factorised once a step. The equations are those of chambers and cables whose amplitude is not
given (`shared_schema.actuators.control`), or that of a path on which the load factor s is unknown:

.. math:: c(u) = f · u + \sum_j ± a_j \, q_j(u) = c_{given}, \qquad
   \frac{∂c}{∂u} = f + \sum_j a_j \, g_j = -\frac{∂R}{∂s}

with the full loads. c grows with the volumes of chambers under pressure, also where their pressure
falls, beyond a limit point of the load.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc

if TYPE_CHECKING:
    from datagen.solver.equilibrium import EquilibriumProblem

Array = NDArray[np.float64]
CLOSE = 1e-9  # of equations, relative to lengths and volumes at rest
REASONS = PETSc.SNES.ConvergedReason


class Border(Protocol):
    """More unknowns, with as many equations; arrays are the same on every rank."""

    def forces(self, u: Array) -> list[Array]:
        """The g of every unknown at a displacement: (n_points, d) each."""

    def equations(self, u: Array, stiffness: Array) -> tuple[Array, Array, Array]:
        """h, ∂h/∂a and ± ∂h/∂q, (m,) each; stiffnesses are dq/da at least in order of size."""

    def change(self, by: Array) -> None:
        """Add δa, (m,), to the unknowns."""


class UnknownAmplitudes:
    """Amplitudes of the following loads that are not given."""

    def __init__(self, problem: EquilibriumProblem) -> None:
        following = problem.load.following
        assert following is not None
        self._problem, self._loads, self._numbers = problem, following, following.unknown

    def forces(self, u: Array) -> list[Array]:
        """Unit forces."""
        return [self._loads.unit_forces(number, u) for number in self._numbers]

    def equations(self, u: Array, stiffness: Array) -> tuple[Array, Array, Array]:
        """Those of the controls."""
        loads, quantities = self._loads, self._loads.quantities(u)
        rows = []
        for number, stiff in zip(self._numbers, stiffness, strict=True):
            state = self._problem.load_factor, loads.found[number], float(quantities[number])
            h = loads.controls[number].equation(*state, float(stiff))
            rows.append((h.value, h.by_amplitude, loads.loads[number].sign * h.by_quantity))
        h_values, by_amplitude, by_quantity = np.array(rows).T
        return h_values, by_amplitude, by_quantity

    def change(self, by: Array) -> None:
        """Add to the amplitudes."""
        self._loads.found[self._numbers] += by


class UnknownLoadFactor:
    """The load factor of a path.

    Parameters
    ----------
    problem : EquilibriumProblem
        Dead forces and given pressures and tensions act, no grip and no tool.

    Attributes
    ----------
    given : float
        c in J.
    scale : float
        A change of c in J, to which the equation is relative.
    """

    def __init__(self, problem: EquilibriumProblem) -> None:
        self._problem, self.given, self.scale = problem, 0.0, 1.0

    def work(self, u: Array) -> float:
        """The c of a displacement of all points, in J (collective)."""
        load = self._problem.load
        assert load.following is not None
        signs = np.array([each.sign for each in load.following.loads])
        full = signs * load.following.amplitudes(1.0) @ load.following.quantities(u)
        return float(self._problem.comm.allreduce(load.work()) + full)

    def forces(self, u: Array) -> list[Array]:
        """Full load."""
        load = self._problem.load
        assert load.following is not None
        return [load.dead_forces() + load.following.forces(u, 1.0)]

    def equations(self, u: Array, stiffness: Array) -> tuple[Array, Array, Array]:
        """That of the path."""
        h = (self.work(u) - self.given) / self.scale
        return np.array([h]), np.zeros(1), np.array([1 / self.scale])

    def change(self, by: Array) -> None:
        """Add to the load factor."""
        self._problem.load_factor += float(by[0])


def solve_bordered(
    problem: EquilibriumProblem, border: Border, x: PETSc.Vec, most: int
) -> tuple[int, int, float]:
    """Iterate from x, which then holds the last iterate, converged or not (collective).

    Parameters
    ----------
    problem : EquilibriumProblem
        Its load factor is the present one.
    border : Border
    x : PETSc.Vec
        Not the vector of the state itself.
    most : int
        Largest number of iterations.

    Returns
    -------
    reason, iterations : int
        PETSc's SNESConvergedReason, and the number of Newton iterations.
    residual_norm : float
        In N.
    """
    newton, load = problem.newton, problem.load
    residual, y = problem.residual, problem.residual.duplicate()
    solver, stiffness = newton.direct_solver(), np.ones(0)
    reason, norm, iteration = REASONS.DIVERGED_MAX_IT, np.inf, 0
    columns: list[tuple[PETSc.Vec, PETSc.Vec]] = []
    for iteration in range(most + 1):
        problem.compute_residual(newton.snes, x, residual)
        norm = residual.norm()
        if not np.isfinite(norm):
            reason = REASONS.DIVERGED_FNORM_NAN
            break
        u = problem.displacement_of_points()
        unit = border.forces(u)
        stiffness = stiffness if len(stiffness) else np.ones(len(unit))
        h, by_amplitude, by_quantity = border.equations(u, stiffness)
        close = norm <= problem.relative_tolerance(x.norm()) and np.abs(h).max() <= CLOSE
        if close and iteration:
            reason = REASONS.CONVERGED_FNORM_ABS
            break
        if iteration == most:
            break
        problem.meanwhile(iteration, norm)
        solver.setOperators(problem.next_tangent())
        solver.solve(residual, y)
        while len(columns) < len(unit):
            columns.append((y.duplicate(), y.duplicate()))
        for (g, w), forces in zip(columns, unit, strict=True):
            g.set(0.0)
            load.add_to(g, forces)
            row = g.array_r.copy()
            g.array_w[problem.supports.owned_fixed] = 0.0
            solver.solve(g, w)
            g.array_w[:] = row
        if solver.getConvergedReason() < 0:
            reason = REASONS.DIVERGED_LINEAR_SOLVE
            break
        response = np.array([[g.dot(w) for _, w in columns] for g, _ in columns])
        stiffness = 1 / np.maximum(np.abs(np.diag(response)), np.finfo(float).tiny)
        left = np.array([g.dot(y) for g, _ in columns])
        matrix = np.diag(by_amplitude) + by_quantity[:, None] * response
        try:
            change = np.linalg.solve(matrix, by_quantity * left - h)
        except np.linalg.LinAlgError:
            reason = REASONS.DIVERGED_LINEAR_SOLVE
            break
        x.axpy(-1.0, y)
        for (_, w), by in zip(columns, change, strict=True):
            x.axpy(by, w)
        border.change(change)
    for vector in (y, *(each for pair in columns for each in pair)):
        vector.destroy()
    return int(reason), iteration, float(norm)
