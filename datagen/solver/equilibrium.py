r"""Equilibrium of one body under nodal loads, by Newton's method (PETSc SNES).

The unknown is the displacement :math:`u`, (n_nodes, d) in m. In equilibrium the residual vanishes
(Deshpande et al. 2022, Eq. res):

.. math:: R(u) = f_{int}(u) - s f - s f_p(u) = 0 \quad \text{at free nodes}, \qquad
          u = 0 \quad \text{at clamped nodes}, \qquad u = s \bar u \quad \text{where prescribed},

with the internal forces :math:`f_{int}` of `datagen.solver.weak_form`, the nodal load :math:`f` in
N, the forces :math:`f_p` of pressures that follow the surface (`datagen.solver.follower_pressure`),
and the load factor :math:`s`, the part of the load that acts. Step k of Newton's method is

.. math:: K(u_k) \, Δu_k = -R(u_k), \qquad u_{k+1} = u_k + Δu_k, \qquad K = ∂f_{int}/∂u,

and the iteration ends when :math:`‖R‖_2` is at most the tolerance. In the rows of the clamped
degrees of freedom the residual is u and the tangent is the identity. Where a displacement is
prescribed the residual is :math:`u - s \bar u`; the first step moves the rest of the body with it.

Over several ranks, each rank owns some nodes, with their rows of residual and tangent. A nodal
force is subtracted on the rank that owns the node, after the internal forces of all cells have been
summed, and before the rows of the clamped nodes are replaced.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import dolfinx
import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc

from datagen.dolfinx_versions import create_vector, functionspace
from datagen.materials import OwnMaterial
from datagen.mesh.distributed_mesh import Mesh
from datagen.mesh.node_numbering import node_numbering
from datagen.solver.distributed_assembly import DistributedAssembly
from datagen.solver.follower_pressure import FollowerPressure
from datagen.solver.linear_solver import INEXACT_TOLERANCE, set_up_direct, set_up_multigrid
from datagen.solver.minimum_jacobian import MinimumJ
from datagen.solver.serial_assembly import SerialAssembly
from datagen.solver.settings import SolverSettings
from datagen.solver.weak_form import weak_form
from shared_schema.common.errors import InputError
from shared_schema.common.nodal_forces import sum_per_node
from shared_schema.material import Material

INVERTED = "inverted element (J <= 0)"
STRESS_FREE = 1e-9  # largest force in the undeformed body, over stiffness times size


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
    numbering : NodeNumbering
        Node numbers of this rank's degrees of freedom.
    forms : WeakForm
        Strain energy, internal forces and tangent at `u`.
    supports : list of dolfinx Dirichlet conditions
        u = 0 at the clamped nodes.
    u : dolfinx.fem.Function
        Displacement in m: the current state of the body.
    snes : petsc4py.PETSc.SNES
        The Newton solver.
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
        parts: NDArray[np.int64] | None = None,
        moved: NDArray[np.bool_] | None = None,
        surfaces: Sequence[NDArray[np.int64]] = (),
    ) -> None:
        self.mesh = mesh
        self.comm = mesh.domain.comm
        self.dimension = mesh.coordinates.shape[1]
        space = functionspace(mesh.domain, ("Lagrange", 1, (self.dimension,)))
        self.numbering = node_numbering(mesh, space)
        self.u = dolfinx.fem.Function(space, name="displacement")
        local_parts = None if parts is None else mesh.of_local_cells(parts)
        self.forms = weak_form(self.u, material, local_parts)

        held = clamped if clamped.ndim == 2 else np.repeat(clamped[:, None], self.dimension, axis=1)
        self.supports = self._supports(held, space)
        self._clamped = self._owned_dofs(held)
        self._moved = np.empty(0, dtype=np.intp) if moved is None else self._owned_dofs(moved)
        self._prescribed = np.zeros(len(self._moved))
        internal, tangent = self.forms.internal, self.forms.tangent
        moves = None if moved is None or not moved.any() else self._moved
        self._assembly: SerialAssembly | DistributedAssembly
        if self.comm.size == 1:
            self._assembly = SerialAssembly(
                internal, tangent, self.u, self._clamped, moves, local_parts
            )
        else:
            self._assembly = DistributedAssembly(internal, tangent, self.supports, moves)
        self._min_j = MinimumJ(self.u)

        self._load_dofs = np.empty(0, dtype=np.intp)
        self._load_values = np.empty(0)
        self._pressure: FollowerPressure | None = None
        if len(surfaces):
            is_moved = np.zeros_like(held) if moved is None else moved
            self._pressure = FollowerPressure(
                mesh.coordinates,
                surfaces,
                self.numbering,
                self._row_of_node(space),
                held | is_moved,
                is_moved,
            )
        self.load_factor = 0.0
        self.meanwhile: Callable[[], None] = lambda: None

        self._residual = create_vector(space)
        self._x = self._residual.duplicate()  # SNES must not be given the vector of `u` itself
        self._inverted = False
        self._settings = settings
        self.is_direct = settings.linear_solver == "lu"
        self.snes = self._make_snes(self.is_direct)
        self._direct_snes = self.snes if self.is_direct else None  # else made when first needed
        if any(isinstance(m, OwnMaterial) for m in (material, *_several(material))):
            self._require_no_stress_at_rest()

    def _make_snes(self, direct: bool) -> PETSc.SNES:
        settings = self._settings
        snes = PETSc.SNES().create(self.comm)
        snes.setFunction(self._compute_residual, self._residual)
        snes.setJacobian(self._compute_tangent, self._assembly.matrix)
        atol = settings.tolerance * (1.0 if direct else INEXACT_TOLERANCE)
        snes.setTolerances(rtol=0.0, atol=atol, stol=0.0, max_it=settings.max_iterations)
        snes.setType("newtonls")
        if direct:
            set_up_direct(snes, self.dimension)
        else:
            owned = self.numbering.node_of_block[: self.numbering.owned]
            set_up_multigrid(snes, self.mesh.coordinates[owned])
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
            local = displacement[self.numbering.node_of_block].ravel()
            self._prescribed[:] = local[self._moved]
        nodes, forces = sum_per_node(nodes, forces)
        positions, blocks = self.numbering.owned_blocks(nodes)
        self._load_dofs = self._dofs_of(blocks)
        self._load_values = np.ascontiguousarray(forces[positions]).ravel()

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
            self._direct_snes = self._direct_snes or self._make_snes(direct=True)
            snes = self._direct_snes
        self.load_factor = load_factor
        self._inverted = False
        self._x.array_w[:] = self.u.x.array[: self._x.local_size]
        snes.solve(None, self._x)
        self._take(self._x)
        reason, residual_norm = snes.getConvergedReason(), snes.getFunctionNorm()
        reasons = PETSc.SNES.ConvergedReason
        if reason == reasons.DIVERGED_MAX_IT and residual_norm <= self._settings.tolerance:
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
        for thing in (self.snes, self._direct_snes, self._assembly.matrix, self._residual, self._x):
            if thing is not None:
                thing.destroy()

    def reset(self) -> None:
        """Set the displacement to zero."""
        self.u.x.array[:] = 0.0

    def set_displacement(self, displacement: NDArray[np.float64]) -> None:
        """Set the displacement: (n_nodes, d) in m by node number, the same on every rank."""
        self.u.x.array[:] = displacement[self.numbering.node_of_block].ravel()

    def state(self) -> NDArray[np.float64]:
        """Copy the displacement of this rank's degrees of freedom, ghosts included."""
        return self.u.x.array.copy()

    def restore(self, state: NDArray[np.float64]) -> None:
        """Set the displacement to a copy made by `state`."""
        self.u.x.array[:] = state

    def displacement(self) -> NDArray[np.float64]:
        """Gather the displacement by node number: (n_nodes, d) in m, the same on every rank."""
        return self._gather(self.u.x.array)

    def reactions(self) -> NDArray[np.float64]:
        """Gather f_int(u) − s f − s f_p(u) by node number: (n_nodes, d) in N, on every rank.

        In equilibrium these forces vanish at the free nodes; at the clamped nodes they are the
        reactions of the supports, and where displacements are prescribed those of the grip.
        """
        self._assemble_out_of_balance(self._residual)
        return self._gather(self._residual.array_r)

    def energy(self) -> float:
        """Integrate the strain energy ∫ W dV of the current state, in J; the same on every rank."""
        local = dolfinx.fem.assemble_scalar(self.forms.energy)
        return float(self.comm.allreduce(local))

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
        pressed = self._pressure is not None and self._pressure.pressures.any()
        return not pressed and not len(self._prescribed)

    def hold_supports(self) -> None:
        """Set the displacement of the clamped nodes to zero."""
        self.u.x.array[self._clamped] = 0.0
        self.u.x.scatter_forward()

    def tangent(self) -> PETSc.Mat:
        """Assemble K = ∂f_int/∂u in N/m at the current state, the identity in the clamped rows."""
        self._assembly.assemble_tangent()
        matrix = self._assembly.matrix
        if self._pressure is not None and self._pressure.pressures.any():
            self._pressure.add_tangent(matrix, self.displacement(), self.load_factor)
        return matrix

    def _dofs_of(self, blocks: NDArray[Any]) -> NDArray[np.intp]:
        """Local degrees of freedom of given blocks, d for each block in turn."""
        dofs = blocks[:, None].astype(np.intp) * self.dimension + np.arange(self.dimension)
        return np.asarray(dofs.ravel())

    def _owned_dofs(self, components: NDArray[np.bool_]) -> NDArray[np.intp]:
        """Degrees of freedom of this rank among some components, (n_nodes, d)."""
        owned = self.numbering.node_of_block[: self.numbering.owned]
        return np.flatnonzero(components[owned].ravel())

    def _supports(self, held: NDArray[np.bool_], space: Any) -> list[Any]:
        """Dirichlet conditions u = 0: of nodes, and of single components of others."""
        local = held[self.numbering.node_of_block]
        clamped = local.all(axis=1)
        zero = np.zeros(self.dimension, dtype=PETSc.ScalarType)
        blocks = np.flatnonzero(clamped).astype(np.int32)
        supports = [dolfinx.fem.dirichletbc(zero, blocks, space)]
        for axis in range(self.dimension):
            single = np.flatnonzero(local[:, axis] & ~clamped).astype(np.int32)
            dofs = single * self.dimension + axis
            value = PETSc.ScalarType(0.0)
            supports.append(dolfinx.fem.dirichletbc(value, dofs.astype(np.int32), space.sub(axis)))
        return supports

    def _row_of_node(self, space: Any) -> NDArray[np.int64]:
        """Position of every node among the blocks of the distributed matrix, (n_nodes,)."""
        first = space.dofmap.index_map.local_range[0]
        numbers = self.numbering.node_of_block[: self.numbering.owned]
        row_of_node = np.empty(self.numbering.total, dtype=np.int64)
        for start, some in self.comm.allgather((first, numbers)):
            row_of_node[some] = start + np.arange(len(some))
        return row_of_node

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

    def _gather(self, local: NDArray[np.float64]) -> NDArray[np.float64]:
        """Collect the owned values of all ranks by node number: (n_nodes, d) on every rank."""
        owned = self.numbering.owned
        part = local[: owned * self.dimension].reshape(owned, self.dimension)
        numbers = self.numbering.node_of_block[:owned]
        result = np.empty((self.numbering.total, self.dimension))
        if self.comm.size == 1:
            result[numbers] = part
        else:
            for some_numbers, values in self.comm.allgather((numbers, part)):
                result[some_numbers] = values
        return result

    def _take(self, x: PETSc.Vec) -> None:
        """Set the displacement to the solver's vector, and update the ghosts."""
        owned = self.numbering.owned * self.dimension
        self.u.x.array[:owned] = x.array_r
        if self.comm.size > 1:
            self.u.x.scatter_forward()

    def _assemble_out_of_balance(self, b: PETSc.Vec) -> None:
        """Replace `b` by f_int(u) − s f, clamped rows included."""
        self._assembly.assemble_forces(b)
        b.array_w[self._load_dofs] -= self.load_factor * self._load_values
        if self._pressure is not None and self._pressure.pressures.any():
            numbers = self.numbering.node_of_block[: self.numbering.owned]
            pushed = self._pressure.forces(self.displacement())[numbers].ravel()
            b.array_w[: len(pushed)] -= self.load_factor * pushed

    def _compute_residual(self, snes: PETSc.SNES, x: PETSc.Vec, b: PETSc.Vec) -> None:
        """Residual for SNES; NaN where an element is inverted, so that the solve fails."""
        self._take(x)
        if self._min_j.value() <= 0.0:
            self._inverted = True
            b.array_w[:] = np.nan  # SNES stops with DIVERGED_FNORM_NAN; the load step is cut back
            return
        self._assemble_out_of_balance(b)
        b.array_w[self._clamped] = x.array_r[self._clamped]  # u = 0 there
        if len(self._moved):
            wanted = self.load_factor * self._prescribed
            b.array_w[self._moved] = x.array_r[self._moved] - wanted

    def _compute_tangent(self, snes: PETSc.SNES, x: PETSc.Vec, a: PETSc.Mat, p: PETSc.Mat) -> None:
        """Tangent for SNES, at the displacement that the residual was computed for."""
        self.meanwhile()
        self.tangent()


def _several(material: Material | Sequence[Material]) -> tuple[Material, ...]:
    return () if isinstance(material, Material) else tuple(material)


def reason_name(reason: int) -> str:
    """Name of a SNESConvergedReason, as PETSc spells it."""
    names = {v: k for k, v in vars(PETSc.SNES.ConvergedReason).items() if isinstance(v, int)}
    return names.get(reason, str(reason))
