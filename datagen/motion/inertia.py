r"""Inertia and damping of a body: what a time step adds to its equilibrium.

A step seeks the u' with (`shared_schema.motion.scheme`)

.. math:: R_s(u') + f_v(u', v_d) + k M (u' - u^*) + M g + r R(u, v, t) = 0 .

Viscous stresses (Kelvin and Voigt) are those of the rate of strain, in the deformed body,

.. math:: f_v · w = \int_Ω S_v : \operatorname{sym}(F^T ∇w) \, dV, \qquad
          S_v = 2 μ b \dot E, \qquad \dot E = \operatorname{sym}(F^T ∇v_d),

with the shear modulus μ at rest. They turn with the body, do no work on it but dissipate
:math:`2 μ b |\dot E|^2 \ge 0`, and no change of volume locks. With :math:`v_d = s (u' - u_v)` they
are forces of u' alone; between two states, :math:`F = I + ∇(u' + u_v) / 2` is that of the middle.
"""

from __future__ import annotations

from typing import Any

import dolfinx
import numpy as np
import ufl
from numpy.typing import NDArray
from petsc4py import PETSc
from scipy.sparse import csr_array

from datagen.discretisation.element import ElementKind
from datagen.discretisation.element_loop import FormLoop, Kernel
from datagen.discretisation.unknowns import Unknowns
from datagen.dolfinx_versions import (
    COMPILER_OPTIONS,
    cell_kernels,
    form,
    functionspace,
    pack_constants,
)
from datagen.mesh.distributed_mesh import Mesh
from datagen.solver.assembly import Assembly
from datagen.solver.strain_energy import deformation_gradient
from shared_schema.common.bodies.reference_cells import NAMES
from shared_schema.motion import Begun, Scheme, mass_blocks

Array = NDArray[np.float64]


class Inertia:
    """Inertia and damping of a body that may be distributed over ranks, as a term of its assembly.

    Arrays of entries are those of the state of a rank, ghosts included.

    Parameters
    ----------
    mesh : Mesh
    unknowns : Unknowns
    kind : ElementKind
    assembly : Assembly
        Takes the forces.
    density : array, (n_cells,)
        ρ in kg/m³, of all cells of the mesh.
    viscosity : array, (n_cells,)
        2 μ b in Pa s, of all cells.
    lumped : bool
        The mass is diagonal.

    Attributes
    ----------
    bears : array of bool
        Entries that are displacements, and have a mass.
    only_damps : bool
        Forces are those of damping alone, without inertia and what is carried on.
    begun : Begun
        Of the present step.
    """

    def __init__(
        self,
        mesh: Mesh,
        unknowns: Unknowns,
        kind: ElementKind,
        assembly: Assembly,
        density: Array,
        viscosity: Array,
        lumped: bool,
    ) -> None:
        self._assembly, self._unknowns = assembly, unknowns
        blocks = _blocks(mesh, unknowns, density, lumped)
        self.mass, self._in_tangent = _assembled(blocks, unknowns, assembly)
        self.bears = np.zeros(len(assembly.forces), dtype=bool)
        self.bears[unknowns.point_dofs] = True
        nothing = np.zeros(len(assembly.forces))
        self.begun, self.rule = Begun(nothing, nothing, nothing), Scheme.energy_momentum(1.0)
        self._carried, self.only_damps = nothing[: unknowns.owned], False
        local = mesh.of_local_cells(viscosity)[: len(unknowns.cell_dofs)]
        self._viscous = _Viscous(unknowns, kind, assembly, local) if viscosity.any() else None

    def stand(self, rule: Scheme, u: Array, v: Array) -> None:
        """Let damping act at a displacement in m and a velocity in m/s, before the first step."""
        self._set(rule, Begun(u, v, np.zeros_like(u)))

    def begin(self, rule: Scheme, u: Array, v: Array, a: Array, carried: Array) -> None:
        """Begin a step from displacement, velocity and acceleration.

        Parameters
        ----------
        rule : Scheme
        u, v, a : array
            In m, m/s and m/s²; 0 of entries without a mass.
        carried : array, (n_owned,)
            The last forces out of balance R(u, v, t) in N.
        """
        self._carried = np.where(self.bears[: len(carried)], rule.carried * carried, 0.0)
        self._set(rule, rule.begin(u, v, a))

    def _set(self, rule: Scheme, begun: Begun) -> None:
        self.rule, self.begun = rule, begun
        if self._viscous is not None:
            slope = rule.damping_slope
            self._viscous.begin(slope, self.begun.u - self.begun.v / slope, rule.between)

    def add_forces(self) -> None:
        """Add the forces of the step, or of damping alone."""
        u, forces, rule = self._unknowns.state.x.array, self._assembly.forces, self.rule
        if self.only_damps:
            if rule.mass_damping:
                velocity = np.where(self.bears, rule.damping_velocity(self.begun, u), 0.0)
                forces += rule.mass_damping * (self.mass @ velocity)
        else:
            away = rule.spring * (u - self.begun.u) + self.begun.g
            forces += self.mass @ np.where(self.bears, away, 0.0)
            forces[: len(self._carried)] += self._carried
        if self._viscous is not None:
            self._viscous.forces.add()

    def add_tangent(self) -> None:
        """Add their derivative, with that of inertia in any case."""
        self._assembly.tangent += self.rule.spring * self._in_tangent
        if self._viscous is not None:
            self._viscous.tangent.add()

    def add_mass(self) -> None:
        """Add the mass alone to the tangent."""
        self._assembly.tangent += self._in_tangent

    def kinetic_energy(self, velocity: Array) -> float:
        """Energy of the cells of this rank in J, by the velocity in m/s."""
        return float(velocity @ (self.mass @ velocity)) / 2


class _Viscous:
    """Loops over the cells of a rank that evaluate f_v and its tangent."""

    def __init__(
        self, unknowns: Unknowns, kind: ElementKind, assembly: Assembly, viscosity: Array
    ) -> None:
        state, self._dofs = unknowns.state, unknowns.cell_dofs
        space = state.function_space
        origin = dolfinx.fem.Function(space)
        modulus = dolfinx.fem.Function(functionspace(space.mesh, ("DG", 0, (1,))))
        slope, part = (dolfinx.fem.Constant(space.mesh, PETSc.ScalarType(1.0)) for _ in "sp")
        test = ufl.TestFunction(space)
        u, rest, w = (_displacement(each, kind) for each in (state, origin, test))
        f = deformation_gradient(part * u + (1 - part) * rest)
        rate = ufl.sym(f.T * ufl.grad(slope * (u - rest)))
        dx = ufl.Measure("dx", space.mesh, metadata={"quadrature_degree": kind.quadrature_degree})
        forces: Any = modulus[0] * ufl.inner(rate, ufl.sym(f.T * ufl.grad(w))) * dx
        tangent = ufl.derivative(forces, state, ufl.TrialFunction(space))
        given = np.zeros((len(self._dofs), self._dofs.shape[1] + 1))
        given[:, -1] = viscosity
        self.forces, of_forces = _loop(forces, unknowns, given, self._dofs, assembly.forces)
        self.tangent, of_tangent = _loop(
            tangent, unknowns, given, assembly.places, assembly.tangent
        )
        self._constants = of_forces, of_tangent

    def begin(self, slope: float, origin: Array, between: bool) -> None:
        """Set s in 1/s and u_v in m, and whether the middle of u' and u_v is deformed."""
        for constants in self._constants:
            constants[:] = slope, 0.5 if between else 1.0
        for loop in (self.forces, self.tangent):
            loop.give(origin[self._dofs])


def _loop(
    expression: Any, unknowns: Unknowns, given: Array, places: NDArray[np.int32], values: Array
) -> tuple[FormLoop, Array]:
    """Loop of a form over all cells, and its constants."""
    compiled = form(expression, COMPILER_OPTIONS)
    constants = np.array(pack_constants(compiled))
    kernels = {part: Kernel(each, constants) for part, each in cell_kernels(compiled).items()}
    known = unknowns.state, unknowns.cell_dofs, places, len(values)
    return FormLoop(kernels, *known, given=given, values=values), constants


def _displacement(function: Any, kind: ElementKind) -> Any:
    """Displacement of a state, with other unknowns or without."""
    return ufl.split(function)[0] if kind.has_pressure else function


def _blocks(mesh: Mesh, unknowns: Unknowns, density: Array, lumped: bool) -> Array:
    """Masses of this rank's own cells, (n_cells, n_points, n_points), in FFCx's order of points."""
    count, points = len(unknowns.cell_dofs), unknowns.points
    cells, name = mesh.of_local_cells(mesh.cells)[:count], mesh.cell_type
    whole = mesh.of_local_cells(np.arange(len(mesh.cells)))[:count]
    known = mesh.coordinates[cells], density[whole]
    if points is not None:
        cells, name = points.cells[whole], NAMES[name]
    blocks = mass_blocks(name, *known, lumped)
    numbers = unknowns.point_numbering.node_of_block[unknowns.cell_points]
    ours, theirs = np.argsort(numbers, axis=1), np.argsort(cells, axis=1)
    place = np.empty_like(ours)
    np.put_along_axis(place, ours, theirs, axis=1)
    rows = np.take_along_axis(blocks, place[:, :, None], axis=1)
    return np.take_along_axis(rows, place[:, None, :], axis=2)


def _assembled(blocks: Array, unknowns: Unknowns, assembly: Assembly) -> tuple[csr_array, Array]:
    """Masses of a rank as a matrix of its entries, and as values of the tangent."""
    cells, count, _ = blocks.shape
    d, entries = unknowns.point_dofs.shape[1], unknowns.cell_dofs.shape[1]
    dofs = unknowns.cell_dofs[:, : count * d].reshape(cells, count, d)
    places = assembly.places.reshape(cells, entries, entries)
    size, in_tangent = len(assembly.forces), np.zeros(len(assembly.tangent))
    rows, columns = [], []
    for axis in range(d):
        of_axis = places[:, axis : count * d : d, axis : count * d : d]
        in_tangent += np.bincount(of_axis.ravel(), blocks.ravel(), len(in_tangent))
        rows.append(np.repeat(dofs[:, :, axis], count, axis=1).ravel())
        columns.append(np.tile(dofs[:, :, axis], (1, count)).ravel())
    values = np.tile(blocks.ravel(), d)
    where = np.concatenate(rows), np.concatenate(columns)
    matrix = csr_array((values, where), shape=(size, size))
    matrix.sum_duplicates()
    return matrix, in_tangent
