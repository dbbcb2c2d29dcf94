r"""Equilibrium of one body under nodal loads: the forms, and Newton's method by PETSc SNES.

The residual (Deshpande et al. 2022, Eq. res) is

.. math:: R(u) = f_{int}(u) - f_{ext} = 0, \qquad f_{int}(u)·v = \int_Ω P(F) : ∇v \, dV,

with :math:`P = \partial W / \partial F` and :math:`f_{ext}` the vector of nodal forces, which is
added on the rank that owns the node, before the rows of the clamped nodes are replaced.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import dolfinx
import numpy as np
import ufl
from dolfinx.fem import petsc as fem_petsc
from mpi4py import MPI
from numpy.typing import NDArray
from petsc4py import PETSc

from datagen.mesh.distributed_mesh import Mesh, node_numbering
from datagen.solver.distributed_assembly import DistributedAssembly
from datagen.solver.linear_solver import INEXACT_TOLERANCE, set_up_direct, set_up_multigrid
from datagen.solver.material import NeoHookean, deformation_gradient, strain_energy
from datagen.solver.serial_assembly import ElementLoop, SerialAssembly
from datagen.solver.settings import SolverSettings
from shared_schema.common.nodal_forces import sum_per_node

COMPILER_OPTIONS = {"cffi_extra_compile_args": ["-O3"]}  # no -ffast-math: NaN must stay NaN
QUADRATURE_DEGREE = 2  # 2 Gauss points along each axis of a quadrilateral or hexahedron
INVERTED = "inverted element (J <= 0)"


@dataclass(frozen=True)
class NewtonResult:
    """What one Newton solve ended with.

    Attributes
    ----------
    converged : bool
    reason : int
        PETSc's SNESConvergedReason: positive if converged.
    explanation : str
        The reason in words.
    iterations : int
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
        """Whether it was the linear solver that gave up."""
        return bool(self.reason == PETSc.SNES.ConvergedReason.DIVERGED_LINEAR_SOLVE)


class EquilibriumProblem:
    """R(u) = f_int(u) − f_ext = 0 on one mesh; forms, matrix and solver are built once.

    Parameters
    ----------
    mesh : Mesh
        Distributed over the ranks of its communicator; every method is collective over them.
    material : NeoHookean
    clamped : array of bool, (n_nodes,)
        Nodes whose displacement is zero, by node number.
    settings : SolverSettings

    Attributes
    ----------
    u : dolfinx.fem.Function
        The displacement, current state of the body.
    snes : petsc4py.PETSc.SNES
        The Newton solver.
    is_direct : bool
        Whether it solves for its steps directly.
    load_factor : float
        Part of the nodal load that acts.
    """

    def __init__(
        self,
        mesh: Mesh,
        material: NeoHookean,
        clamped: NDArray[np.bool_],
        settings: SolverSettings,
    ) -> None:
        self.mesh = mesh
        self.comm = mesh.domain.comm
        space = dolfinx.fem.VectorFunctionSpace(mesh.domain, ("Lagrange", 1))
        self.numbering = node_numbering(mesh, space)
        self.dimension = mesh.coordinates.shape[1]
        self.u = dolfinx.fem.Function(space, name="displacement")

        lam = dolfinx.fem.Constant(mesh.domain, PETSc.ScalarType(material.lame_lambda))
        mu = dolfinx.fem.Constant(mesh.domain, PETSc.ScalarType(material.lame_mu))
        dx = ufl.Measure("dx", mesh.domain, metadata={"quadrature_degree": QUADRATURE_DEGREE})
        f = deformation_gradient(self.u)
        energy = strain_energy(f, lam, mu, material.volumetric) * dx
        internal = ufl.derivative(energy, self.u)
        tangent = ufl.derivative(internal, self.u)
        jit = COMPILER_OPTIONS
        self.energy_form = dolfinx.fem.form(energy, jit_params=jit)
        self.internal_form = dolfinx.fem.form(internal, jit_params=jit)
        self.tangent_form = dolfinx.fem.form(tangent, jit_params=jit)

        blocks = np.flatnonzero(clamped[self.numbering.node_of_block]).astype(np.int32)
        zero = np.zeros(self.dimension, dtype=PETSc.ScalarType)
        self.supports = [dolfinx.fem.dirichletbc(zero, blocks, space)]
        self._clamped = self._dofs_of(blocks[blocks < self.numbering.owned])
        self._assembly: SerialAssembly | DistributedAssembly
        if self.comm.size == 1:
            self._assembly = SerialAssembly(
                self.internal_form, self.tangent_form, self.u, self._clamped
            )
        else:
            self._assembly = DistributedAssembly(
                self.internal_form, self.tangent_form, self.supports
            )
        self._min_j = MinimumJ(mesh.domain, self.u)

        self._load_dofs = np.empty(0, dtype=np.intp)
        self._load_values = np.empty(0)
        self.load_factor = 0.0

        self._residual = fem_petsc.create_vector(self.internal_form)
        self._x = self._residual.duplicate()  # SNES must not be handed the function's own vector
        self._inverted = False
        self._settings = settings
        self.is_direct = settings.linear_solver == "lu"
        self.snes = self._make_snes(self.is_direct)
        self._direct_snes = self.snes if self.is_direct else None  # made when it is needed

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

    def set_load(self, nodes: NDArray[np.int64], forces: NDArray[np.float64]) -> None:
        """Replace the nodal load.

        Parameters
        ----------
        nodes : array of int, (n_loads,)
            Loaded nodes, by node number; the same on every rank. Forces on one node add up.
        forces : array, (n_loads, d)
            Force vector at each of them, in N.
        """
        nodes, forces = sum_per_node(nodes, forces)
        positions, blocks = self.numbering.owned_blocks(nodes)
        self._load_dofs = self._dofs_of(blocks)
        self._load_values = np.ascontiguousarray(forces[positions]).ravel()

    def solve(self, load_factor: float, direct: bool = False) -> NewtonResult:
        """Solve R(u) = f_int(u) − load_factor · f = 0, starting from the current `u`.

        `u` holds the last iterate afterwards, whether or not it converged.

        Parameters
        ----------
        load_factor : float
        direct : bool
            Solve for the Newton steps directly, whatever the settings say.
        """
        snes = self.snes
        if direct:
            self._direct_snes = self._direct_snes or self._make_snes(direct=True)
            snes = self._direct_snes
        self.load_factor = load_factor
        self._inverted = False
        self.u.vector.copy(self._x)
        snes.solve(None, self._x)
        self._take(self._x)
        reason, residual_norm = snes.getConvergedReason(), snes.getFunctionNorm()
        reasons = PETSc.SNES.ConvergedReason
        if reason == reasons.DIVERGED_MAX_IT and residual_norm <= self._settings.tolerance:
            reason = reasons.CONVERGED_FNORM_ABS  # to go on below it is wanted, not needed
        return NewtonResult(
            converged=reason > 0,
            reason=reason,
            explanation=INVERTED if self._inverted else reason_name(reason),
            iterations=snes.getIterationNumber(),
            residual_norm=residual_norm,
        )

    def close(self) -> None:
        """Give PETSc's memory back, which dropping the object does not; it is of no use then."""
        for thing in (self.snes, self._direct_snes, self._assembly.matrix, self._residual, self._x):
            if thing is not None:
                thing.destroy()

    def reset(self) -> None:
        """Go back to the undeformed body."""
        self.u.x.array[:] = 0.0

    def set_displacement(self, displacement: NDArray[np.float64]) -> None:
        """Put the body into a given state: (n_nodes, d) in m by node number, on every rank."""
        self.u.x.array[:] = displacement[self.numbering.node_of_block].ravel()

    def state(self) -> NDArray[np.float64]:
        """Copy this rank's part of the displacement (with ghosts), to go back to by `restore`."""
        return self.u.x.array.copy()

    def restore(self, state: NDArray[np.float64]) -> None:
        """Take up a state that `state` copied."""
        self.u.x.array[:] = state

    def displacement(self) -> NDArray[np.float64]:
        """Gather the displacement by node number: (n_nodes, d) in m, the same on every rank."""
        return self._gather(self.u.x.array)

    def reactions(self) -> NDArray[np.float64]:
        """Gather the forces f_int(u) − f_ext by node number: (n_nodes, d) in N.

        In equilibrium they vanish except at the clamped nodes, where they are the reactions.
        """
        self._assemble_out_of_balance(self._residual)
        return self._gather(self._residual.array_r)

    def energy(self) -> float:
        """Strain energy ∫ W dV of the current state in J."""
        local = dolfinx.fem.assemble_scalar(self.energy_form)
        return float(self.comm.allreduce(local))

    def tangent(self) -> PETSc.Mat:
        """Assemble ∂f_int/∂u at the current state, with the identity in the clamped rows."""
        self._assembly.assemble_tangent()
        return self._assembly.matrix

    def _dofs_of(self, blocks: NDArray[Any]) -> NDArray[np.intp]:
        """Degrees of freedom of some blocks, component by component."""
        dofs = blocks[:, None].astype(np.intp) * self.dimension + np.arange(self.dimension)
        return np.asarray(dofs.ravel())

    def _gather(self, local: NDArray[np.float64]) -> NDArray[np.float64]:
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
        owned = self.numbering.owned * self.dimension
        self.u.x.array[:owned] = x.array_r
        if self.comm.size > 1:
            self.u.x.scatter_forward()

    def _assemble_out_of_balance(self, b: PETSc.Vec) -> None:
        self._assembly.assemble_forces(b)
        b.array_w[self._load_dofs] -= self.load_factor * self._load_values

    def _compute_residual(self, snes: PETSc.SNES, x: PETSc.Vec, b: PETSc.Vec) -> None:
        self._take(x)
        if self._min_j.value() <= 0.0:
            self._inverted = True
            b.array_w[:] = np.nan  # SNES stops with DIVERGED_FNORM_NAN; the load step is cut back
            return
        self._assemble_out_of_balance(b)
        b.array_w[self._clamped] = x.array_r[self._clamped]  # u = 0 there

    def _compute_tangent(self, snes: PETSc.SNES, x: PETSc.Vec, a: PETSc.Mat, p: PETSc.Mat) -> None:
        self.tangent()


class MinimumJ:
    """Smallest J = det F over the Gauss points, the guard against inverted elements."""

    def __init__(self, domain: Any, u: Any) -> None:
        import basix

        cell = getattr(basix.CellType, domain.topology.cell_type.name)
        points, _ = basix.make_quadrature(cell, QUADRATURE_DEGREE)
        j = ufl.det(deformation_gradient(u))
        self._comm = domain.comm
        self._expression = dolfinx.fem.Expression(j, points, jit_params=COMPILER_OPTIONS)
        count = domain.topology.index_map(domain.topology.dim).size_local
        self._cells = np.arange(count, dtype=np.int32)
        self._loop: ElementLoop | None = None
        if domain.comm.size == 1:
            kernel = self._expression.ufcx_expression.tabulate_tensor_float64
            places = np.arange(count * len(points), dtype=np.int32).reshape(count, -1)
            self._loop = ElementLoop(kernel, np.empty(0), u, places, places.size)

    def value(self) -> float:
        """Smallest J of all cells (collective)."""
        if self._loop is not None:
            return float(self._loop.run().min())
        local = float(self._expression.eval(self._cells).min()) if self._cells.size else np.inf
        return float(self._comm.allreduce(local, op=MPI.MIN))


def reason_name(reason: int) -> str:
    """Name of a SNESConvergedReason, as PETSc spells it."""
    names = {v: k for k, v in vars(PETSc.SNES.ConvergedReason).items() if isinstance(v, int)}
    return names.get(reason, str(reason))
