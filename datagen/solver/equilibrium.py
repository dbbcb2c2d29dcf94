r"""Equilibrium of one body under loads.

The unknown is the displacement :math:`u`, (n_nodes, d) in m. In equilibrium the residual vanishes
(Deshpande et al. 2022, Eq. res):

.. math:: R(u) = f_{int}(u) - s f - f_p(u) = 0 \quad \text{at free nodes}, \qquad
          u = 0 \quad \text{at clamped nodes}, \qquad u = s \bar u \quad \text{where prescribed},

with the internal forces :math:`f_{int}` of `datagen.solver.weak_form`, the dead load
:math:`f` in N, the forces :math:`f_p` of pressures and cables
(`datagen.solver.following_loads`), which grow with s as well, and the load factor :math:`s`, the
part of the load that acts. Newton's method (`datagen.solver.newton`) finds u with the tangent
:math:`K = ∂f_{int}/∂u - ∂f_p/∂u`. In the rows of known displacements
(`datagen.solver.supports`) the residual is u, or :math:`u - s \bar u`, and the tangent is the
identity; the first step moves the rest of the body with a prescribed displacement. In a time step,
inertia and damping (`datagen.motion.inertia`) add to forces and tangent.

Quadratic elements have displacements between the nodes of the mesh as well, and incompressible
triangles and tetrahedra dilations and pressures (`datagen.discretisation`); u and R then hold all
of them. Loads act on all points (`shared_schema.common.bodies.points_between`), and
pressures on the facets that these span. Supports and results are those of the nodes of the mesh,
the corners of the cells: a displacement is prescribed between corners where it is at all of them.

Over several ranks, each rank owns some points, with their rows of residual and tangent. A force is
subtracted on the rank that owns the point, after the internal forces of all cells have been
summed, and before the rows of the clamped nodes are replaced.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc

from datagen.discretisation.element import Element, element_kind
from datagen.discretisation.unknowns import Unknowns
from datagen.dolfinx_versions import create_vector
from datagen.mesh.distributed_mesh import Mesh
from datagen.solver.acting_load import ActingLoad
from datagen.solver.assembly import Assembly, Internal, MinimumJ, Term
from datagen.solver.bordered_newton import (
    Border,
    UnknownAmplitudes,
    UnknownLoadFactor,
    solve_bordered,
)
from datagen.solver.corotation import Corotation
from datagen.solver.linear_solver import chosen_solver
from datagen.solver.load_series import LoadSeries
from datagen.solver.newton import Newton, NewtonResult, reason_name, round_off
from datagen.solver.settings import SolverSettings
from datagen.solver.strain_energy import fibre_field
from datagen.solver.supports import Drag, Supports
from datagen.solver.weak_form import weak_form
from shared_schema.actuators import Control
from shared_schema.common.bodies.equilibrium import ForceTolerance, mean_edge
from shared_schema.common.bodies.following_loads import FollowingLoad
from shared_schema.materials import Material

INVERTED = "inverted element (J <= 0)"
LINEAR_LOADS = 1e6  # loads below so many times the rounding errors of the residual at rest
SLOW = {True: 0.6, False: 0.1}  # of a residual, that a kept tangent may leave; by LU, or not
KEPT = 40  # iterations of Newton's method with tangents of before, beyond those of the settings


class EquilibriumProblem:
    """R(u) = f_int(u) − s f − f_p(u) = 0 on one mesh; forms, matrix and solver are built once.

    Parameters
    ----------
    mesh : Mesh
        Distributed over the ranks of its communicator. Every method is collective over them.
    material : Material, or sequence of some
    clamped : array of bool, (n_nodes,) or (n_nodes, d)
        True for nodes, or for components of them, whose displacement is zero, by node number.
    settings : SolverSettings
    element : {"linear", "quadratic", "incompressible"}
    parts : array of int, (n_cells,), optional
        Position of each cell's material in the sequence.
    moved : array of bool, (n_nodes, d), optional
        Components whose displacement is prescribed by the loads.
    following : sequence of FollowingLoad
        Pressures and cables.

    Raises
    ------
    InputError
        If the energy of a user's own material is none, has no positive stiffness at rest or changes
        by a rotation (`require_elastic`), or the undeformed body is under stress.

    Attributes
    ----------
    mesh : Mesh
    dimension : int
        Number of space dimensions d.
    kind : ElementKind
        The element on the cells of the mesh.
    points : array, (n_owned_points, d)
        Positions in m of the points that this rank owns, in the order of their degrees of freedom.
    unknowns : Unknowns
    numbering : NodeNumbering
        Node numbers of the cells' corners on this rank.
    forms : WeakForm
        Strain energy, internal forces and tangent at `u`.
    u : dolfinx.fem.Function
        The current state of the body in m: displacements, and other unknowns if there are any.
    supports : Supports
        Held and moved degrees of freedom.
    load : ActingLoad
        Dead forces and pressures.
    residual : petsc4py.PETSc.Vec
        R; overwritten by most methods.
    matrix : petsc4py.PETSc.Mat
        K.
    newton : Newton
        Newton's method.
    linear_solver : str
        Name of the linear solver that it uses.
    corotation : Corotation or None
        Preconditioner of the linear solver `corotated`.
    series : LoadSeries or None
        Where Newton's method begins from rest, with the linear solver `corotated`.
    load_factor : float
        Part s of the nodal load that acts.
    drag : Drag or None
        Forces that hold the body back, of a state that is not in equilibrium yet.
    assembly : Assembly
        Forces and tangent of the cells.
    inertia : Term or None
        Inertia and damping, in a time step (`move`).
    inertia_norm : float
        2-norm of the largest forces of inertia in N, beside which a residual is small.
    keeps_tangent, has_tangent : bool
        Newton's method goes on with the factors of a tangent of before while it converges; it has
        one.
    meanwhile : callable
        Called on every rank before each step of Newton's method, with the number of those before
        and ‖R‖ in N, for work that must not wait long.
    """

    def __init__(
        self,
        mesh: Mesh,
        material: Material | Sequence[Material],
        clamped: NDArray[np.bool_],
        settings: SolverSettings,
        element: Element = "linear",
        parts: NDArray[np.int64] | None = None,
        moved: NDArray[np.bool_] | None = None,
        following: Sequence[FollowingLoad] = (),
        fibres: NDArray[np.float64] | None = None,
    ) -> None:
        self.mesh, self.comm = mesh, mesh.domain.comm
        self.dimension = mesh.coordinates.shape[1]
        self.kind = element_kind(element, mesh.cell_type)
        self.unknowns = Unknowns(mesh, self.kind)
        self.numbering, self.u = self.unknowns.numbering, self.unknowns.state
        self.points = self.unknowns.owned_points(mesh.coordinates)
        size = mean_edge(mesh.coordinates, mesh.cells)
        local_parts = None if parts is None else mesh.of_local_cells(parts)
        materials = [material] if isinstance(material, Material) else material
        field = fibre_field(mesh, materials, parts, fibres)
        self._of_forms = self.unknowns, self.kind, material, size, local_parts, field
        self.forms = weak_form(*self._of_forms)
        held = clamped if clamped.ndim == 2 else np.repeat(clamped[:, None], self.dimension, axis=1)
        self.supports = Supports(
            self.unknowns, held, np.zeros_like(held) if moved is None else moved
        )
        self.load = ActingLoad(mesh, self.unknowns, self.supports, following)
        fixed = self.supports.held_dofs, self.supports.moved_dofs, self.load.coupled()
        self.assembly = Assembly(self.forms, self.unknowns, *fixed)
        self._internal = self.assembly.internal_forces
        self.matrix = self.assembly.matrix
        self._min_j = MinimumJ(self.unknowns, self.kind)
        to_one = np.zeros((len(self.unknowns.cell_dofs), 1), dtype=np.int32)
        self._energy = self.forms.loop(self.forms.energy, self.unknowns, to_one, 1)
        self.load_factor = 0.0
        self.drag: Drag | None = None
        self.inertia: Term | None = None
        self.inertia_norm = 0.0
        self.keeps_tangent = self.has_tangent = False
        self._last_norm = np.inf
        self.meanwhile: Callable[[int, float], None] = lambda step, residual: None
        self.residual = create_vector(self.u.function_space)
        self._x = self.residual.duplicate()  # SNES must not be given the vector of `u` itself
        self._inverted = self._is_loaded = False
        self._settings, self._grip_norm = settings, 0.0
        self._tolerance = ForceTolerance(settings.relative_tolerance, settings.tolerance)
        self._round_off = self._round_off_at_rest = round_off(self.tangent(), size)
        self.linear_solver = chosen_solver(
            settings.linear_solver, self.kind, self.dimension, self.size
        )
        self.corotation: Corotation | None = None
        if self.linear_solver == "corotated":
            self.corotation = Corotation(
                self.tangent().copy(),
                not self.supports.has_grip,
                self.unknowns,
                self.kind,
                mesh.coordinates,
            )
        self.newton = Newton(self, settings, self.linear_solver, self.corotation)
        self.series: LoadSeries | None = None
        if self.corotation is not None:
            self.series = LoadSeries(self, self.corotation.solver_at_rest(), size)

    @property
    def size(self) -> int:
        """Number of unknowns."""
        return int(self.residual.size)

    @property
    def is_linear(self) -> bool:
        """True if the load is so small that rounding hides all but the linear response."""
        smallest = LINEAR_LOADS * self._round_off.at_rest
        return not self._has_unknown_forces and self.load.norm <= smallest

    @property
    def _has_unknown_forces(self) -> bool:
        """True if there are forces that are not given: of a grip, a tool, a chamber of fluid."""
        return self.supports.has_grip or self.load.contact is not None or self.load.is_bordered

    @property
    def is_dead(self) -> bool:
        """True if the load consists of dead forces, which have a potential."""
        return not self.load.presses and not self.supports.has_grip

    @property
    def has_path(self) -> bool:
        """True if pressures or tensions are given, and all other forces are dead ones."""
        following = self.load.following
        return following is not None and following.acts and not self._has_unknown_forces

    def set_load(
        self,
        nodes: NDArray[np.int64],
        forces: NDArray[np.float64],
        controls: Sequence[Control] = (),
        displacement: NDArray[np.float64] | None = None,
        between: NDArray[np.float64] | None = None,
    ) -> None:
        """Replace the load; each rank keeps the forces at the points that it owns.

        Parameters
        ----------
        nodes : array of int, (n_loads,)
            Loaded nodes, by node number; the same on every rank. Forces on one node add up.
        forces : array, (n_loads, d)
            Force vector at each of them, in N; the same on every rank.
        controls : sequence of Control, optional
            What is given of each following load; by default they do not act.
        displacement : array, (n_nodes, d), optional
            Displacement of the moved components in m; 0 by default.
        between : array, (n_between, d), optional
            Forces between the nodes of quadratic elements in N, the same on every rank; 0 by
            default. Other elements ignore them.
        """
        moves = self.supports.prescribe(displacement)
        self.load.set(nodes, forces, controls, between)
        self._grip_norm = 0.0
        self._is_loaded = self.load.norm > 0.0 or moves or self._has_unknown_forces
        if self._settings.tolerance is not None:
            self.newton.stop_at(self.relative_tolerance(0.0), self._round_off.at_rest)

    def tolerance(self) -> float:
        """Tolerance on ‖R‖ in N under the present load, at the present state (collective)."""
        self._x.array_w[:] = self.u.x.array[: self._x.local_size]
        return self.relative_tolerance(self._x.norm())

    def relative_tolerance(self, displacement_norm: float) -> float:
        """Tolerance on ‖R‖ in N by ‖u‖ in m, relative to load and grip."""
        forces = float(np.linalg.norm([self.load.norm, self._grip_norm, self.inertia_norm]))
        unknown = self._has_unknown_forces or forces == 0.0
        if self._settings.tolerance is not None and unknown:
            return self._settings.tolerance  # the forces of a grip are not known before
        tolerance = self._tolerance.under(forces, self._round_off, displacement_norm)
        return tolerance if self.load.contact is None else tolerance + self.load.contact.round_off

    def solve(self, load_factor: float, direct: bool = False) -> NewtonResult:
        """Solve R(u) = f_int(u) − load_factor · f = 0 by Newton's method, starting from `u`.

        Afterwards `u` holds the last iterate, converged or not. A failure to converge raises
        nothing; it is reported in the result.

        Parameters
        ----------
        load_factor : float
            Part s of the nodal load.
        direct : bool
            Solve the linear systems by LU, even if the settings ask for multigrid.
        """
        self.load_factor, contact = load_factor, self.load.contact
        self._inverted = False
        multipliers = None if contact is None else contact.state()
        self._predict_from_here()
        self._x.array_w[:] = self.u.x.array[: self._x.local_size]
        if self.load.is_bordered:
            result = self._solved_with(UnknownAmplitudes(self))
            if contact is not None and multipliers is not None and not result.converged:
                contact.restore(multipliers)
            return result
        reason, iterations, residual_norm = self.newton.solve(
            self._x,
            is_loaded=self._is_loaded,
            is_linear=self.is_linear,
            predicts=self.forms.before is not None,
            direct=direct,
            inertial=self.inertia is not None,
        )
        self._take(self._x)
        reasons = PETSc.SNES.ConvergedReason
        if reason == reasons.DIVERGED_MAX_IT and residual_norm <= self.tolerance():
            # Inexact steps iterate to INEXACT_TOLERANCE · tolerance; the tolerance itself suffices.
            reason = reasons.CONVERGED_FNORM_ABS
        if contact is not None and multipliers is not None and reason <= 0:
            contact.restore(multipliers)
        return self._result(reason, iterations, residual_norm)

    def _result(self, reason: int, iterations: int, residual_norm: float) -> NewtonResult:
        return NewtonResult(
            converged=reason > 0,
            reason=reason,
            explanation=INVERTED if self._inverted else reason_name(reason),
            iterations=iterations,
            residual_norm=residual_norm,
        )

    def solve_on_path(self, path: UnknownLoadFactor) -> NewtonResult:
        """Solve R(u, s) = 0 for displacement and load factor, from both as they are (collective).

        Afterwards they are the last iterate, converged or not, as `solve` leaves them.
        """
        self._inverted = False
        self._predict_from_here()
        self._x.array_w[:] = self.u.x.array[: self._x.local_size]
        return self._solved_with(path)

    def _solved_with(self, border: Border) -> NewtonResult:
        """Solve with unknowns beside the state, from `_x`; they are as before if that fails."""
        following = self.load.following
        found = None if following is None else following.found.copy()
        result = solve_bordered(self, border, self._x, self._settings.max_iterations)
        self._take(self._x)
        if following is not None and result[0] <= 0:
            following.found[:] = found
        return self._result(*result)

    def residual_at(self, owned: NDArray[np.float64], load_factor: float) -> NDArray[np.float64]:
        """R by the unknowns that this rank owns (collective); NaN where a cell is inverted."""
        self.load_factor, self._inverted = load_factor, False
        self._x.array_w[:] = owned
        self.compute_residual(self.newton.snes, self._x, self.residual)
        values: NDArray[np.float64] = self.residual.array_r.copy()
        return values

    def close(self) -> None:
        """Release PETSc's memory, which garbage collection does not; unusable afterwards."""
        if self.series is not None:
            self.series.close()
        self.newton.close()
        for thing in (self.matrix, self.residual, self._x):
            thing.destroy()

    def reset(self) -> None:
        """Set the displacement and all other unknowns to zero."""
        self.u.x.array[:] = 0.0
        if self.load.following is not None:
            self.load.following.found[:] = 0.0

    def set_displacement(self, displacement: NDArray[np.float64]) -> None:
        """Set the displacement: (n_nodes, d) in m by node number, the same on every rank."""
        self.reset()
        self.unknowns.set_displacement(displacement)

    def state(self) -> NDArray[np.float64]:
        """Copy the state of this rank's degrees of freedom, ghosts included."""
        return self.u.x.array.copy()

    def restore(self, state: NDArray[np.float64]) -> None:
        """Set the state to a copy made by `state`."""
        self.u.x.array[:] = state

    def move_by(self, change: NDArray[np.float64]) -> None:
        """Add a change of the unknowns that this rank owns to the state (collective)."""
        self.unknowns.set_owned(self.u.x.array[: self.unknowns.owned] + change)

    def displacement(self) -> NDArray[np.float64]:
        """Gather the displacement by node number: (n_nodes, d) in m, the same on every rank."""
        return self.numbering.gathered(self.comm, self.u.x.array[self.unknowns.dofs])

    def positions(self) -> NDArray[np.float64]:
        """Gather the positions of all points of the elements: (n_points, d) in m (collective)."""
        x, points = self.mesh.coordinates, self.unknowns.points
        at_rest = x if points is None else points.interpolated(x)
        return at_rest + self.displacement_of_points()

    def displacement_of_points(self) -> NDArray[np.float64]:
        """Gather the displacement of all points of the elements: (n_points, d) in m (collective).

        The nodes are the first points.
        """
        numbering = self.unknowns.point_numbering
        return numbering.gathered(self.comm, self.u.x.array[self.unknowns.point_dofs])

    def reactions(self) -> NDArray[np.float64]:
        """Gather f_int(u) − s f − f_p(u) by node number: (n_nodes, d) in N, on every rank.

        In equilibrium these forces vanish at the free nodes; at the clamped nodes they are the
        reactions of the supports, and where displacements are prescribed those of the grip. A
        force between nodes counts as those at the nodes that do the same work.
        """
        forces, points = self._reactions_of_points(), self.unknowns.points
        return forces if points is None else points.on_nodes(forces)

    def grip(self) -> NDArray[np.float64]:
        """Gather the forces that hold prescribed displacements: (n_points, d) in N, on every rank.

        They are 0 at all other points. With the points' own forces, they hold the body as it is.
        """
        points, supports = self.unknowns.points, self.supports
        fixed, held = supports.fixed, supports.fixed & ~supports.moved
        if points is not None:
            fixed, held = points.held(fixed), points.held(held)
        return np.where(fixed & ~held, self._reactions_of_points(), 0.0)

    def _reactions_of_points(self) -> NDArray[np.float64]:
        """Gather f_int(u) − s f − f_p(u) of all points: (n_points, d) in N, on every rank."""
        values = np.zeros(len(self.u.x.array))
        values[: self.unknowns.owned] = self.out_of_balance().array_r
        numbering = self.unknowns.point_numbering
        return numbering.gathered(self.comm, values[self.unknowns.point_dofs])

    def energy(self) -> float:
        """Integrate the strain energy ∫ W dV of the current state, in J; the same on every rank."""
        return float(self.comm.allreduce(float(self._energy.run()[0])))

    def potential(self) -> float:
        """Integrate Π(u) = ∫ W dV − f · u under the full load, in J; the same on every rank.

        +∞ if an element is inverted or the displacement is not finite.
        """
        if self.is_inverted:
            return np.inf
        potential = self.energy() - float(self.comm.allreduce(self.load.work()))
        return potential if np.isfinite(potential) else np.inf

    def tangent(self) -> PETSc.Mat:
        """Assemble K = ∂f_int/∂u in N/m at the current state, the identity in the clamped rows."""
        self._predict_from_here()
        return self.next_tangent()

    def move(self, inertia: Term | None, between: bool = False) -> Internal:
        """Let inertia act from now on, or no longer; return the internal forces (collective).

        Parameters
        ----------
        inertia : Term, optional
        between : bool
            Internal forces are those between two states.
        """
        internal = self._internal
        if between:
            internal = self.assembly.internal(weak_form(*self._of_forms, between=True))
        self.assembly.terms = [internal] if inertia is None else [internal, inertia]
        self.inertia, self.inertia_norm = inertia, 0.0
        self._round_off = self._round_off_at_rest
        self.keeps_tangent = self.has_tangent = False
        if inertia is None:
            self.newton.iterate_in_time(self._settings.max_iterations)
        return internal

    def renew(self, keeps_tangent: bool) -> None:
        """Let Newton's method begin with a new tangent, and say whether it may keep it then.

        The rounding errors of residuals are estimated anew (collective).
        """
        size = mean_edge(self.mesh.coordinates, self.mesh.cells)
        self._round_off = round_off(self.tangent(), size)
        self.keeps_tangent = keeps_tangent and self.forms.before is None
        self.newton.iterate_in_time(self._settings.max_iterations + KEPT * self.keeps_tangent)

    def tangent_of_last_step(self) -> PETSc.Mat | None:
        """K before the last Newton step, if it is that at the current state as well, else None."""
        known = not self.load.is_bordered and self.newton.last_tangent_is_of(self._x)
        return self.matrix if known else None

    def _predict_from_here(self) -> None:
        """Let the next tangent take its pressures from what that at the current state predicts."""
        if self.forms.before is not None:
            self.forms.before[:] = self.u.x.array

    def next_tangent(self) -> PETSc.Mat:
        """`tangent` within Newton's method, which predicts pressures from its last state."""
        self.assembly.assemble_tangent()
        self.has_tangent = False
        self._predict_from_here()
        if self.load.presses:
            self.load.add_tangent(self.matrix, self.load_factor, self.displacement_of_points())
        if self.drag is not None:
            self.drag.add_tangent(self.matrix)
        return self.matrix

    @property
    def is_inverted(self) -> bool:
        """True if an element is inverted in the current state (collective)."""
        return not self._min_j.value() > 0.0

    def _take(self, x: PETSc.Vec) -> None:
        """Set the displacement to the solver's vector, and update the ghosts."""
        self.unknowns.set_owned(x.array_r)

    def out_of_balance(self, b: PETSc.Vec | None = None) -> PETSc.Vec:
        """Set `residual`, or b, to f_int(u) − s f − f_p(u), in the rows of supports as well."""
        b = self.residual if b is None else b
        self.assembly.assemble_forces(b)
        self.load.subtract_forces(b, self.load_factor)
        if self.load.presses:
            self.load.subtract_following(b, self.load_factor, self.displacement_of_points())
        return b

    def compute_residual(self, snes: PETSc.SNES, x: PETSc.Vec, b: PETSc.Vec) -> None:
        """Residual for SNES; NaN where an element is inverted, so that the solve fails."""
        self._take(x)
        if self._min_j.value() <= 0.0:
            self._inverted = True
            b.array_w[:] = np.nan  # SNES stops with DIVERGED_FNORM_NAN; the load step is cut back
            return
        grip = self.supports.replace_rows(self.out_of_balance(b), x, self.load_factor)
        if self.drag is not None:
            self.drag.add_forces(b, x)
        if self.supports.has_grip:
            self._grip_norm = float(np.sqrt(self.comm.allreduce(float(grip @ grip))))
        if self.load.contact is not None or self.load.is_bordered:
            grip_norm = self._grip_norm if self.supports.has_grip else 0.0
            touch_norm = self.load.touch_norm if self.load.contact is not None else 0.0
            follow_norm = self.load.follow_norm if self.load.is_bordered else 0.0
            self._grip_norm = float(np.linalg.norm([grip_norm, touch_norm, follow_norm]))

    def compute_tangent(self, snes: PETSc.SNES, x: PETSc.Vec, a: PETSc.Mat, p: PETSc.Mat) -> None:
        """Tangent for SNES, at the displacement that the residual was computed for."""
        iteration, norm = snes.getIterationNumber(), snes.getFunctionNorm()
        self.meanwhile(iteration, norm)
        if self.inertia is not None:
            if not self._may_keep_tangent(iteration, norm):
                self.next_tangent()
                self.has_tangent = True
            return
        if self.corotation is None:
            self.next_tangent()
            return
        if x.norm() == 0.0 and not self.load.presses:
            self.corotation.undeformed.copy(a, PETSc.Mat.Structure.SAME_NONZERO_PATTERN)
        else:
            self.next_tangent()
        self.corotation.turn()

    def _may_keep_tangent(self, iteration: int, norm: float) -> bool:
        """True if a step with the last tangent promises to reduce the residual enough."""
        before, self._last_norm = self._last_norm, norm
        if not (self.keeps_tangent and self.has_tangent) or self.load.contact is not None:
            return False
        if iteration == 0:
            return True
        return norm <= SLOW[self.newton.used_lu] * before and iteration < KEPT
