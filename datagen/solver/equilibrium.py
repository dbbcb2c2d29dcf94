r"""Equilibrium of one body under nodal loads, by Newton's method (PETSc SNES).

The unknown is the displacement :math:`u`, (n_nodes, d) in m. In equilibrium the residual vanishes
(Deshpande et al. 2022, Eq. res):

.. math:: R(u) = f_{int}(u) - s f - s f_p(u) = 0 \quad \text{at free nodes}, \qquad
          u = 0 \quad \text{at clamped nodes}, \qquad u = s \bar u \quad \text{where prescribed},

with the internal forces :math:`f_{int}` of `datagen.solver.weak_form`, the nodal load :math:`f` in
N, the forces :math:`f_p` of pressures that follow the surface (`datagen.solver.follower_pressure`),
and the load factor :math:`s`, the part of the load that acts. Step k of Newton's method is

.. math:: K(u_k) \, Δu_k = -R(u_k), \qquad u_{k+1} = u_k + Δu_k, \qquad K = ∂f_{int}/∂u,

and the iteration ends when :math:`‖R‖_2` is at most the tolerance (`datagen.solver.tolerance`). In
the rows of the clamped degrees of freedom the residual is u and the tangent is the identity. Where
a displacement is prescribed the residual is :math:`u - s \bar u`; the first step moves the rest of
the body with it.

Quadratic elements have displacements between the nodes of the mesh as well, and incompressible
triangles and tetrahedra dilations and pressures (`datagen.discretisation`); u and R then hold all
of them. Loads, supports and results are those of the nodes of the mesh, the corners of the cells: a
displacement is prescribed between corners where it is at all of them, and a pressure acts on the
facets that the corners span.

Over several ranks, each rank owns some nodes, with their rows of residual and tangent. A nodal
force is subtracted on the rank that owns the node, after the internal forces of all cells have been
summed, and before the rows of the clamped nodes are replaced.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc

from datagen.discretisation.element import Element, element_kind
from datagen.discretisation.unknowns import Unknowns, mean_edge
from datagen.dolfinx_versions import create_vector
from datagen.materials import OwnMaterial
from datagen.mesh.distributed_mesh import Mesh
from datagen.solver.corotation import Corotation
from datagen.solver.distributed_assembly import DistributedAssembly
from datagen.solver.follower_pressure import FollowerPressure
from datagen.solver.linear_solver import (
    INEXACT_TOLERANCE,
    Solver,
    chosen_solver,
    set_up_direct,
    set_up_multigrid,
    set_up_preconditioned,
)
from datagen.solver.minimum_jacobian import MinimumJ
from datagen.solver.serial_assembly import SerialAssembly
from datagen.solver.settings import SolverSettings
from datagen.solver.tolerance import RoundOff
from datagen.solver.weak_form import weak_form
from shared_schema.common.errors import InputError
from shared_schema.common.nodal_forces import sum_per_node
from shared_schema.material import Material

INVERTED = "inverted element (J <= 0)"
STRESS_FREE = 1e-9  # largest force in the undeformed body, over stiffness times size
LINEAR_LOADS = 1e6  # loads below so many times the rounding errors of the residual at rest
EXACT = 1e-10  # relative tolerance of Krylov iterations under such loads
FORETELLING = 1e-4  # of those of nearly incompressible cells


@dataclass(frozen=True)
class NewtonResult:
    """Outcome of one Newton solve.

    Attributes
    ----------
    converged : bool
    reason : int
        PETSc's SNESConvergedReason: positive if converged.
    explanation : str
        The reason in words.
    iterations : int
        Number of Newton iterations.
    residual_norm : float
        2-norm of the last residual, in N.
    """

    converged: bool
    reason: int
    explanation: str
    iterations: int
    residual_norm: float

    @property
    def linear_solve_failed(self) -> bool:
        """True if Newton's method stopped because the linear solver failed."""
        return bool(self.reason == PETSc.SNES.ConvergedReason.DIVERGED_LINEAR_SOLVE)


class EquilibriumProblem:
    """R(u) = f_int(u) − s f − s f_p(u) = 0 on one mesh; forms, matrix and solver are built once.

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
    surfaces : sequence of array of int, (n_facets, n_corners)
        Facets under pressures that follow them, by node number and seen from outside.

    Raises
    ------
    InputError
        If the energy of a user's own material is none, or the undeformed body is under stress.

    Attributes
    ----------
    mesh : Mesh
    dimension : int
        Number of space dimensions d.
    kind : ElementKind
        The element on the cells of the mesh.
    unknowns : Unknowns
    numbering : NodeNumbering
        Node numbers of the cells' corners on this rank.
    forms : WeakForm
        Strain energy, internal forces and tangent at `u`.
    u : dolfinx.fem.Function
        The current state of the body in m: displacements, and other unknowns if there are any.
    snes : petsc4py.PETSc.SNES
        The Newton solver.
    linear_solver : str
        Name of the linear solver that `snes` uses.
    corotation : Corotation or None
        Preconditioner of the linear solver `corotated`.
    is_direct : bool
        True if `snes` solves the linear systems by LU.
    load_factor : float
        Part s of the nodal load that acts.
    meanwhile : callable
        Called on every rank at each step of Newton's method, for work that must not wait long.
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
        surfaces: Sequence[NDArray[np.int64]] = (),
    ) -> None:
        self.mesh = mesh
        self.comm = mesh.domain.comm
        self.dimension = mesh.coordinates.shape[1]
        self.kind = element_kind(element, mesh.cell_type)
        self.unknowns = Unknowns(mesh, self.kind)
        self.numbering, self.u = self.unknowns.numbering, self.unknowns.state
        size = mean_edge(mesh.coordinates, mesh.cells)
        local_parts = None if parts is None else mesh.of_local_cells(parts)
        self.forms = weak_form(self.unknowns, self.kind, material, size, local_parts)

        fixed = (
            clamped if clamped.ndim == 2 else np.repeat(clamped[:, None], self.dimension, axis=1)
        )
        self._is_moved = np.zeros_like(fixed) if moved is None else moved
        self._is_driven = bool(self._is_moved.any())
        held_points = self.unknowns.held(fixed)
        self._moved_points = self.unknowns.held(fixed | self._is_moved) & ~held_points
        held, driven = (
            self.unknowns.point_dofs[points].astype(np.intp)
            for points in (held_points, self._moved_points)
        )
        self._held = held[held < self.unknowns.owned]
        self._owns_moved = driven < self.unknowns.owned
        self._moved = driven[self._owns_moved]
        self._prescribed = np.zeros(len(self._moved))
        self._assembly: SerialAssembly | DistributedAssembly
        assembly = SerialAssembly if self.comm.size == 1 else DistributedAssembly
        self._assembly = assembly(self.forms, self.unknowns, held, driven)
        self._min_j = MinimumJ(self.unknowns, self.kind)
        to_one = np.zeros((len(self.unknowns.cell_dofs), 1), dtype=np.int32)
        self._energy = self.forms.loop(self.forms.energy, self.unknowns, to_one, 1)

        self._load_dofs = np.empty(0, dtype=np.intp)
        self._load_values = np.empty(0)
        self._pressure: FollowerPressure | None = None
        if len(surfaces):
            self._pressure = FollowerPressure(
                mesh.coordinates,
                surfaces,
                self.numbering,
                self._rows_of_nodes(),
                fixed | self._is_moved,
                self._is_moved,
            )
        self.load_factor = 0.0
        self.meanwhile: Callable[[], None] = lambda: None

        self._residual = create_vector(self.u.function_space)
        self._x = self._residual.duplicate()  # SNES must not be given the vector of `u` itself
        self._inverted = self._is_loaded = False
        self._settings = settings
        self._round_off = RoundOff(0.0, 0.0)
        if settings.tolerance is None:
            self._round_off = RoundOff.of(self.tangent(), size)
        self._force_norm = self._grip_norm = 0.0
        self.linear_solver = chosen_solver(
            settings.linear_solver, self.kind, self.dimension, self._residual.size
        )
        self.corotation: Corotation | None = None
        if self.linear_solver == "corotated":
            at_rest = self.tangent().copy()
            self.corotation = Corotation(at_rest, self.unknowns, self.kind, mesh.coordinates)
        self.is_direct = self.linear_solver == "lu"
        self.snes = self._make_snes(self.linear_solver)
        self._direct_snes = self.snes if self.is_direct else None  # else made when first needed
        if any(isinstance(m, OwnMaterial) for m in (material, *_several(material))):
            self._require_no_stress_at_rest()

    @property
    def size(self) -> int:
        """Number of unknowns."""
        return int(self._residual.size)

    def _make_snes(self, linear_solver: Solver) -> PETSc.SNES:
        settings = self._settings
        snes = PETSc.SNES().create(self.comm)
        snes.setFunction(self._compute_residual, self._residual)
        snes.setJacobian(self._compute_tangent, self._assembly.matrix)
        snes.setTolerances(rtol=0.0, atol=0.0, stol=0.0, max_it=settings.max_iterations)
        if settings.tolerance is None:
            snes.setConvergenceTest(self._has_converged)
        else:
            stricter = INEXACT_TOLERANCE if linear_solver == "multigrid" else 1.0
            snes.setTolerances(atol=stricter * settings.tolerance)
        snes.setType("newtonls")
        if linear_solver == "lu":
            set_up_direct(snes, self.dimension, self.kind.has_pressure)
            return snes
        if self.corotation is None:
            set_up_multigrid(snes, self.unknowns.owned_points(self.mesh.coordinates))
        else:
            set_up_preconditioned(snes, self.corotation)
        return snes

    def set_load(
        self,
        nodes: NDArray[np.int64],
        forces: NDArray[np.float64],
        pressures: NDArray[np.float64] | None = None,
        displacement: NDArray[np.float64] | None = None,
    ) -> None:
        """Replace the load; each rank keeps the forces at the nodes that it owns.

        Parameters
        ----------
        nodes : array of int, (n_loads,)
            Loaded nodes, by node number; the same on every rank. Forces on one node add up.
        forces : array, (n_loads, d)
            Force vector at each of them, in N; the same on every rank.
        pressures : array, (n_surfaces,), optional
            Pressure on each surface, in Pa; 0 by default.
        displacement : array, (n_nodes, d), optional
            Displacement of the moved components in m; 0 by default.
        """
        if self._pressure is not None:
            self._pressure.pressures[:] = 0.0 if pressures is None else pressures
        self._prescribed[:] = 0.0
        if displacement is not None:
            at_points = self.unknowns.at_points(displacement)[self._moved_points]
            self._prescribed[:] = at_points[self._owns_moved]
        nodes, forces = sum_per_node(nodes, forces)
        positions, blocks = self.numbering.owned_blocks(nodes)
        self._load_dofs = self.unknowns.dofs[blocks].ravel().astype(np.intp)
        self._load_values = np.ascontiguousarray(forces[positions]).ravel()
        self._force_norm = float(np.linalg.norm(forces))
        if self._is_pressed:
            assert self._pressure is not None
            at_rest = self._pressure.forces(np.zeros(self.mesh.coordinates.shape))
            self._force_norm = float(np.hypot(self._force_norm, np.linalg.norm(at_rest)))
        self._grip_norm = 0.0
        self._is_loaded = self._force_norm > 0.0 or (
            displacement is not None and bool(displacement[self._is_moved].any())
        )

    def tolerance(self) -> float:
        """Tolerance on ‖R‖ in N under the present load, at the present state (collective)."""
        if self._settings.tolerance is not None:
            return self._settings.tolerance
        self._x.array_w[:] = self.u.x.array[: self._x.local_size]
        return self._relative_tolerance(self._x.norm())

    def _relative_tolerance(self, displacement_norm: float) -> float:
        forces = float(np.hypot(self._force_norm, self._grip_norm))
        relative = self._settings.relative_tolerance * forces
        return max(relative, self._round_off.floor(displacement_norm))

    def _has_converged(
        self, snes: PETSc.SNES, iteration: int, norms: tuple[float, float, float]
    ) -> int:
        """Convergence test for SNES, if the tolerance is relative; one iteration at least."""
        reasons = PETSc.SNES.ConvergedReason
        displacement, _, residual = norms
        if iteration == 0 and self._is_loaded:
            return int(reasons.ITERATING)
        small = residual <= self._relative_tolerance(displacement)
        return int(reasons.CONVERGED_FNORM_ABS if small else reasons.ITERATING)

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
        snes = self.snes
        if direct:
            self._direct_snes = self._direct_snes or self._make_snes("lu")
            snes = self._direct_snes
        if snes is not self._direct_snes:
            is_linear = not self._is_driven and (
                self._force_norm <= LINEAR_LOADS * self._round_off.at_rest
            )
            foretells = self.forms.before is not None
            snes.setUseEW(not is_linear and not foretells)
            if is_linear:  # rounding may hide what a first, inexact step leaves
                snes.getKSP().setTolerances(rtol=EXACT)
            elif foretells:  # a pressure; an inexact step would foretell a wrong one
                snes.getKSP().setTolerances(rtol=FORETELLING)
        snes.setForceIteration(self._is_loaded)
        self.load_factor = load_factor
        self._inverted = False
        self._foretell_from_here()
        self._x.array_w[:] = self.u.x.array[: self._x.local_size]
        snes.solve(None, self._x)
        self._take(self._x)
        reason, residual_norm = snes.getConvergedReason(), snes.getFunctionNorm()
        reasons = PETSc.SNES.ConvergedReason
        if reason == reasons.DIVERGED_MAX_IT and residual_norm <= self.tolerance():
            # Inexact steps iterate to INEXACT_TOLERANCE · tolerance; the tolerance itself suffices.
            reason = reasons.CONVERGED_FNORM_ABS
        return NewtonResult(
            converged=reason > 0,
            reason=reason,
            explanation=INVERTED if self._inverted else reason_name(reason),
            iterations=snes.getIterationNumber(),
            residual_norm=residual_norm,
        )

    def close(self) -> None:
        """Release PETSc's memory, which garbage collection does not; unusable afterwards."""
        for thing in (
            self.snes,
            self._direct_snes,
            self._assembly.matrix,
            self._residual,
            self._x,
        ):
            if thing is not None:
                thing.destroy()

    def reset(self) -> None:
        """Set the displacement and all other unknowns to zero."""
        self.u.x.array[:] = 0.0

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

    def displacement(self) -> NDArray[np.float64]:
        """Gather the displacement by node number: (n_nodes, d) in m, the same on every rank."""
        return self._gather(self.u.x.array[self.unknowns.dofs])

    def reactions(self) -> NDArray[np.float64]:
        """Gather f_int(u) − s f − s f_p(u) by node number: (n_nodes, d) in N, on every rank.

        In equilibrium these forces vanish at the free nodes; at the clamped nodes they are the
        reactions of the supports, and where displacements are prescribed those of the grip.
        """
        self._assemble_out_of_balance(self._residual)
        values = np.zeros(len(self.u.x.array))
        values[: self.unknowns.owned] = self._residual.array_r
        return self._gather(self.unknowns.forces_at_corners(values), add=True)

    def energy(self) -> float:
        """Integrate the strain energy ∫ W dV of the current state, in J; the same on every rank."""
        return float(self.comm.allreduce(float(self._energy.run()[0])))

    def potential(self) -> float:
        """Integrate Π(u) = ∫ W dV − f · u under the full load, in J; the same on every rank.

        +∞ if an element is inverted or the displacement is not finite.
        """
        if not self._min_j.value() > 0.0:
            return np.inf
        work = self.u.x.array[self._load_dofs] @ self._load_values
        potential = self.energy() - float(self.comm.allreduce(work))
        return potential if np.isfinite(potential) else np.inf

    @property
    def is_dead(self) -> bool:
        """True if the load consists of dead forces, which have a potential."""
        return not self._is_pressed and not self._is_driven

    @property
    def _is_pressed(self) -> bool:
        return self._pressure is not None and bool(self._pressure.pressures.any())

    def hold_supports(self) -> None:
        """Set the displacement of the clamped nodes to zero."""
        self.u.x.array[self._held] = 0.0
        self.u.x.scatter_forward()

    def tangent(self) -> PETSc.Mat:
        """Assemble K = ∂f_int/∂u in N/m at the current state, the identity in the clamped rows."""
        self._foretell_from_here()
        return self._next_tangent()

    def _foretell_from_here(self) -> None:
        """Let the next tangent take its pressures from what that at the current state foretells."""
        if self.forms.before is not None:
            self.forms.before[:] = self.u.x.array

    def _next_tangent(self) -> PETSc.Mat:
        self._assembly.assemble_tangent()
        self._foretell_from_here()
        matrix = self._assembly.matrix
        if self._is_pressed:
            assert self._pressure is not None
            self._pressure.add_tangent(matrix, self.displacement(), self.load_factor)
        return matrix

    def _rows_of_nodes(self) -> NDArray[np.int64]:
        """Rows of the distributed matrix that belong to every node, (n_nodes, d)."""
        index_map = self.u.function_space.dofmap.index_map
        first = index_map.local_range[0] * self.u.function_space.dofmap.index_map_bs
        owned = self.numbering.owned
        numbers, rows = self.numbering.node_of_block[:owned], self.unknowns.dofs[:owned]
        rows_of_nodes = np.empty((self.numbering.total, self.dimension), dtype=np.int64)
        for some, of_some in self.comm.allgather((numbers, first + rows)):
            rows_of_nodes[some] = of_some
        return rows_of_nodes

    def _require_no_stress_at_rest(self) -> None:
        """Raise InputError if internal forces act in the undeformed body (collective)."""
        self.reset()
        forces = self.reactions()
        stiffness = self.tangent()
        size = float(np.ptp(self.mesh.coordinates, axis=0).max())
        scale = stiffness.norm(PETSc.NormType.NORM_INFINITY) * size
        if not np.abs(forces).max() <= STRESS_FREE * scale:  # true for NaN as well
            raise InputError(
                "key 'material': the energy gives forces of "
                f"{np.abs(forces).max():g} N in the undeformed body, expected none"
            )

    def _gather(self, local: NDArray[np.float64], add: bool = False) -> NDArray[np.float64]:
        """Collect values at this rank's corners, (n_corners, d), by node number on every rank.

        Parameters
        ----------
        local : array, (n_corners, d)
            Values of owned nodes, then of ghosts.
        add : bool
            Add the values of ghosts to those of the nodes; otherwise they are left out.
        """
        count = len(local) if add else self.numbering.owned
        part, numbers = local[:count], self.numbering.node_of_block[:count]
        result = np.zeros((self.numbering.total, self.dimension))
        if self.comm.size == 1:
            result[numbers] = part
        else:
            for some_numbers, values in self.comm.allgather((numbers, part)):
                result[some_numbers] += values
        return result

    def _take(self, x: PETSc.Vec) -> None:
        """Set the displacement to the solver's vector, and update the ghosts."""
        self.u.x.array[: self.unknowns.owned] = x.array_r
        if self.comm.size > 1:
            self.u.x.scatter_forward()

    def _assemble_out_of_balance(self, b: PETSc.Vec) -> None:
        """Replace `b` by f_int(u) − s f, clamped rows included."""
        self._assembly.assemble_forces(b)
        b.array_w[self._load_dofs] -= self.load_factor * self._load_values
        if self._is_pressed:
            assert self._pressure is not None
            owned = self.numbering.owned
            pushed = self._pressure.forces(self.displacement())[
                self.numbering.node_of_block[:owned]
            ]
            b.array_w[self.unknowns.dofs[:owned]] -= self.load_factor * pushed

    def _compute_residual(self, snes: PETSc.SNES, x: PETSc.Vec, b: PETSc.Vec) -> None:
        """Residual for SNES; NaN where an element is inverted, so that the solve fails."""
        self._take(x)
        if self._min_j.value() <= 0.0:
            self._inverted = True
            b.array_w[:] = np.nan  # SNES stops with DIVERGED_FNORM_NAN; the load step is cut back
            return
        self._assemble_out_of_balance(b)
        b.array_w[self._held] = x.array_r[self._held]  # u = 0 there
        if self._is_driven:
            grip = b.array_r[self._moved]
            self._grip_norm = float(np.sqrt(self.comm.allreduce(float(grip @ grip))))
            wanted = self.load_factor * self._prescribed
            b.array_w[self._moved] = x.array_r[self._moved] - wanted

    def _compute_tangent(self, snes: PETSc.SNES, x: PETSc.Vec, a: PETSc.Mat, p: PETSc.Mat) -> None:
        """Tangent for SNES, at the displacement that the residual was computed for."""
        self.meanwhile()
        if self.corotation is None:
            self._next_tangent()
            return
        if x.norm() == 0.0 and not self._is_pressed:
            self.corotation.undeformed.copy(a, PETSc.Mat.Structure.SAME_NONZERO_PATTERN)
        else:
            self._next_tangent()
        self.corotation.turn()


def _several(material: Material | Sequence[Material]) -> tuple[Material, ...]:
    return () if isinstance(material, Material) else tuple(material)


def reason_name(reason: int) -> str:
    """Name of a SNESConvergedReason, as PETSc spells it."""
    names = {v: k for k, v in vars(PETSc.SNES.ConvergedReason).items() if isinstance(v, int)}
    return names.get(reason, str(reason))
