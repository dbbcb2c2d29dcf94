r"""Motion of a body, time step by time step.

Each step is an equilibrium with springs to where the body would coast to
(`shared_schema.motion.scheme`, `datagen.motion.inertia`). Newton's method begins at that of

.. math:: u + h v + \tfrac12 h^2 a , \qquad u + h v , \qquad u

with the smallest residual or, where that fails, at u. Its linear systems are solved by LU or, on
large bodies, by GMRES with incomplete factors. It goes on with the factors of an earlier
tangent as long as residuals fall fast enough. A step that fails in any case is taken in two
halves, these in two, and so on.

All that drives the body grows with the factor s(t) of the load: forces, pressures, what is given of
actuators, prescribed displacements, and the tool on its way. A body that is let go is in
equilibrium at first; then all of this is gone at once.

The work of all these forces is their sum over the steps, by the trapezoidal rule. What kinetic and
strain energy lack of it has been dissipated, by damping and by the scheme.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc

from datagen.motion.inertia import Inertia
from datagen.solver.assembly import Internal
from datagen.solver.equilibrium import EquilibriumProblem
from datagen.solver.linear_solver import CROSSOVER
from datagen.solver.newton import NewtonResult, reason_name
from datagen.solver.tool_contact import INSIDE
from shared_schema.common.errors import InputError, WorkError
from shared_schema.materials import Materials, as_tuple
from shared_schema.motion import LoadOverTime, Scheme, TimeSettings, densities_of_cells

Array = NDArray[np.float64]
HALVINGS = 8
EXACT = 1e-14  # relative residual of the first acceleration


class MotionError(WorkError):
    """A step has no solution; the message says when, and why."""


@dataclass(frozen=True)
class Energies:
    """Energies in J since the begin.

    Attributes
    ----------
    kinetic, strain : float
        Of the present state.
    work : float
        Of loads, grips and tools.
    dissipated : float
        By damping and by the scheme.
    """

    kinetic: float
    strain: float
    work: float
    dissipated: float


@dataclass(frozen=True)
class Frame:
    """A body in motion at one time.

    Attributes
    ----------
    number : int
        Number of the step.
    time : float
        In s.
    factor : float
        Of the load.
    displacement, velocity : array, (n_nodes, d)
        In m and m/s.
    energies : Energies
    """

    number: int
    time: float
    factor: float
    displacement: Array
    velocity: Array
    energies: Energies


class Motion:
    """Motion of the body of a problem, under its present load; every method is collective.

    Parameters
    ----------
    problem : EquilibriumProblem
        At the first displacement, with its load set and its tool in place.
    settings : TimeSettings
    inertia : Inertia
        As `inertia_of` makes it.
    load : LoadOverTime
    velocity : array, (n_nodes, d), optional
        First velocity in m/s; 0 by default.

    Raises
    ------
    InputError
        If the scheme does not know forces that act.

    Attributes
    ----------
    problem : EquilibriumProblem
    number, time : int, float
        Number of the last step, and its time in s.
    halvings, iterations : int
        Number of steps that were taken in halves, and of Newton iterations.
    last : NewtonResult or None
        Of the last step.
    """

    def __init__(
        self,
        problem: EquilibriumProblem,
        settings: TimeSettings,
        inertia: Inertia,
        load: LoadOverTime,
        velocity: Array | None = None,
    ) -> None:
        self.problem, self._inertia, self._load = problem, inertia, load
        self._rule = settings.rule
        if self._rule.between and (problem.load.presses or problem.supports.has_grip):
            raise InputError(
                "key 'time.scheme' = 'energy-momentum': expected dead forces only, or "
                "generalised-alpha"
            )
        large = problem.size >= CROSSOVER[problem.dimension]
        self._direct = not (large and problem.kind.dilation == "pointwise")
        self.number, self.time, self._work = 0, 0.0, 0.0
        self.halvings = self.iterations = 0
        self.last: NewtonResult | None = None
        self._internal: Internal = problem.move(inertia, self._rule.between)
        self._u = problem.state()
        self._v, self._a = np.zeros_like(self._u), np.zeros_like(self._u)
        if velocity is not None:
            dofs = problem.unknowns.point_dofs
            self._v[dofs] = problem.unknowns.at_points(velocity)
        inertia.stand(self._rule, self._u, self._v)
        self._give_first()
        problem.renew(not problem.load.is_bordered)
        problem.load_factor = load.factor(0.0)
        self._carried, self._acting = self._balance()
        self._a = self._first_acceleration()
        self._first_energy = problem.energy()

    def _begin(self, rule: Scheme) -> None:
        """Begin a step from the present state."""
        self._inertia.begin(rule, self._u, self._v, self._a, self._carried)
        self._give_first()

    def _give_first(self) -> None:
        """Let the present state be the first of two."""
        if self._rule.between:
            dofs = self.problem.unknowns.cell_dofs
            self._internal.begin(self._u[dofs], self.problem.forms.first_given)

    def _balance(self) -> tuple[Array, Array]:
        """R(u, v, t) at the present state, and the forces that drive the body, (n_owned,) in N."""
        problem, supports = self.problem, self.problem.supports
        loads = problem.residual
        loads.set(0.0)
        problem.load.subtract_forces(loads, problem.load_factor)
        if problem.load.presses:
            u = problem.displacement_of_points()
            problem.load.subtract_following(loads, problem.load_factor, u)
        acting = -loads.array_r
        if self._rule.between and self.number:
            return np.zeros_like(acting), acting
        self._inertia.only_damps = True
        forces = problem.out_of_balance().array_r.copy()
        self._inertia.only_damps = False
        if supports.has_grip:
            held = self._inertia_forces() + forces
            acting[supports.owned_moved] += held[supports.owned_moved]
        return forces, acting

    def _inertia_forces(self) -> Array:
        """M a of the unknowns that this rank owns, in N."""
        return self._summed(self._inertia.mass @ self._a)

    def _summed(self, of_cells: Array) -> Array:
        """Sum forces of the cells of all ranks, at the unknowns that this rank owns."""
        if self.problem.comm.size == 1:
            return of_cells
        total = self.problem.residual.duplicate()
        with total.localForm() as local:
            local.array_w[:] = of_cells
        total.ghostUpdate(addv=PETSc.InsertMode.ADD, mode=PETSc.ScatterMode.REVERSE)
        values: Array = total.array_r.copy()
        total.destroy()
        return values

    def _first_acceleration(self) -> Array:
        """Solve M a = −R at the free unknowns; the others do not move yet."""
        problem, assembly = self.problem, self.problem.assembly
        b, x = problem.residual.duplicate(), problem.residual.duplicate()
        b.array_w[:] = np.where(self._inertia.bears[: len(self._carried)], -self._carried, 0.0)
        b.array_w[problem.supports.owned_fixed] = 0.0
        if b.norm() > 0.0:
            terms = assembly.terms
            assembly.terms = [_Mass(self._inertia)]
            assembly.assemble_tangent()
            assembly.terms = terms
            diagonal = problem.matrix.getDiagonal()
            diagonal.array_w[diagonal.array_r == 0.0] = 1.0
            problem.matrix.setDiagonal(diagonal)
            problem.matrix.assemble()
            ksp = PETSc.KSP().create(problem.comm)
            ksp.setOperators(problem.matrix)
            ksp.setType("cg")
            ksp.getPC().setType("jacobi")
            ksp.setTolerances(rtol=EXACT, max_it=1000)
            ksp.solve(b, x)
            ksp.destroy()
            diagonal.destroy()
        problem.inertia_norm = b.norm()
        problem.unknowns.set_owned(x.array_r)
        acceleration = problem.state()
        problem.restore(self._u)
        b.destroy()
        x.destroy()
        return acceleration

    def step(self) -> None:
        """Take one step.

        Raises
        ------
        MotionError
            If it has no solution; the body is then where it was before the step, or a part of it.
        """
        self.number += 1
        self._advance(self._rule.step, 0)
        self.time = self.number * self._rule.step

    def _advance(self, h: float, depth: int) -> None:
        """Go on by a time h in s, in halves where that fails."""
        result = self.last = self._attempt(replace(self._rule, step=h))
        if result.converged:
            return
        self.halvings += 1
        self.problem.restore(self._u)
        if depth == HALVINGS:
            raise MotionError(
                f"no step beyond {self.time:.6g} s ({result.explanation}), even of {h:.3g} s"
            )
        for _ in range(2):
            self.problem.has_tangent = False
            self._advance(h / 2, depth + 1)
        self.problem.has_tangent = False

    def _attempt(self, rule: Scheme) -> NewtonResult:
        """Take a step if it has a solution."""
        problem, u, v, a = self.problem, self._u, self._v, self._a
        self._begin(rule)
        factor = self._load.factor(rule.force_time(self.time))
        coasting = u + rule.step * v
        starts = [coasting + rule.step**2 / 2 * a, coasting, u]
        residuals = [self._residual(start, factor) for start in starts]
        best = starts[int(np.argmin(residuals))]
        for start in (best, best, u):
            problem.restore(start)
            result = problem.solve(factor, direct=self._direct)
            self.iterations += result.iterations
            if result.converged:
                break
            self._direct |= result.linear_solve_failed
            problem.has_tangent = False
        else:
            return result
        self._u, begun, bears = problem.state(), self._inertia.begun, self._inertia.bears
        self._v = np.where(bears, rule.velocity(begun, self._u), 0.0)
        self._a = np.where(bears, rule.acceleration(begun, self._u), 0.0)
        self.time += rule.step
        before = self._acting
        self._carried, self._acting = self._balance()
        mean = self._acting if rule.between else (before + self._acting) / 2
        self._work += float(mean @ (self._u - u)[: len(mean)])
        largest = float(np.linalg.norm(self._inertia_forces()))
        squares = problem.comm.allreduce(largest**2)
        problem.inertia_norm = max(problem.inertia_norm, float(np.sqrt(squares)))
        self._settle()
        return result

    def _residual(self, state: Array, factor: float) -> float:
        """2-norm of the residual at a state in N; +∞ where a cell is inverted."""
        values = self.problem.residual_at(state[: self.problem.unknowns.owned], factor)
        square = self.problem.comm.allreduce(float(values @ values))
        return square if np.isfinite(square) else np.inf

    def _settle(self) -> None:
        """Let friction begin anew, and see that no node is inside the tool."""
        problem, contact = self.problem, self.problem.load.contact
        if contact is None:
            return
        displacement = problem.displacement()
        contact.settle(displacement, problem.load_factor)
        depth = contact.penetration(displacement, problem.load_factor)
        if depth > INSIDE * np.ptp(problem.mesh.coordinates):
            raise MotionError(f"a node is {depth:.3g} m inside the tool at {self.time:.6g} s")

    def state(self) -> dict[str, Any]:
        """What a rank needs to go on from here, as arrays; the next step has a new tangent."""
        following, contact = self.problem.load.following, self.problem.load.contact
        self.problem.has_tangent, last = False, self.last
        return {
            "vectors": np.array([self._u, self._v, self._a]),
            "forces": np.array([self._carried, self._acting]),
            "numbers": np.array([self.number, self.halvings, self.iterations]),
            "last": np.array([] if last is None else [last.reason, last.residual_norm]),
            "scalars": np.array([self._work, self._first_energy, self.problem.inertia_norm]),
            "found": np.empty(0) if following is None else following.found.copy(),
            "touch": np.empty(0) if contact is None else contact.state()[0],
        }

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go on from a state of the same body on as many ranks, without friction."""
        following, contact = self.problem.load.following, self.problem.load.contact
        self._u, self._v, self._a = state["vectors"]
        self._carried, self._acting = state["forces"]
        self.number, self.halvings, self.iterations = (int(n) for n in state["numbers"])
        self._work, self._first_energy, self.problem.inertia_norm = map(float, state["scalars"])
        if len(state["last"]):
            reason, norm = int(state["last"][0]), float(state["last"][1])
            self.last = NewtonResult(True, reason, reason_name(reason), 0, norm)
        self.time = self.number * self._rule.step
        self.problem.restore(self._u)
        self.problem.load_factor = self._load.factor(self.time)
        self.problem.has_tangent = False
        if following is not None:
            following.found[:] = state["found"]
        if contact is not None:
            contact.restore((state["touch"], None))

    def frame(self) -> Frame:
        """Describe the present state."""
        problem = self.problem
        strain, work = problem.energy(), problem.comm.allreduce(self._work)
        kinetic = problem.comm.allreduce(self._inertia.kinetic_energy(self._v))
        lost = work + self._first_energy - kinetic - strain
        displacement = problem.displacement()
        problem.restore(self._v)
        velocity = problem.displacement()
        problem.restore(self._u)
        energies = Energies(kinetic, strain, work, lost)
        factor = self._load.factor(self.time)
        return Frame(self.number, self.time, factor, displacement, velocity, energies)


@dataclass(frozen=True)
class _Mass:
    """The mass alone, as a term of an assembly."""

    inertia: Inertia

    def add_forces(self) -> None:
        """Add nothing."""

    def add_tangent(self) -> None:
        """Add M."""
        self.inertia.add_mass()


def inertia_of(
    problem: EquilibriumProblem,
    materials: Materials,
    parts: NDArray[np.int64] | None,
    settings: TimeSettings,
) -> Inertia:
    """Set up inertia and damping of the body of a problem (collective).

    Parameters
    ----------
    problem : EquilibriumProblem
    materials : Material, or tuple of some
    parts : array of int, (n_cells,), or None
        Position of each cell's material.
    settings : TimeSettings

    Raises
    ------
    InputError
        If a material has no density, or the elements do not know the scheme.
    """
    mesh, kind = problem.mesh, problem.kind
    if settings.rule.between and kind.dilation != "pointwise":
        raise InputError(
            "key 'time.scheme' = 'energy-momentum': expected generalised-alpha for incompressible "
            "elements"
        )
    count = len(mesh.cells)
    density = densities_of_cells(materials, parts, count)
    shear = np.array([each.lame_mu for each in as_tuple(materials)])
    of_cells = shear[np.zeros(count, dtype=np.int64) if parts is None else parts]
    viscosity = 2 * settings.damping.stiffness * of_cells
    lumped = settings.mass == "lumped"
    known = mesh, problem.unknowns, kind, problem.assembly
    return Inertia(*known, density, viscosity, lumped)
