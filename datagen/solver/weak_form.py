r"""Weak form of equilibrium: strain energy, internal forces and tangent stiffness.

A body occupies :math:`Ω` at rest. Under the displacement :math:`u` its strain energy is

.. math:: E(u) = \int_Ω W(F) \, dV, \qquad F = I + ∇u,

with the energy density W of `datagen.solver.strain_energy`. The internal forces are the
derivative of the energy, the tangent stiffness is the derivative of the internal forces:

.. math::
    f_{int}(u)·v = \frac{dE}{du}[v] = \int_Ω P(F) : ∇v \, dV, \quad P = \frac{∂W}{∂F},
    \qquad K(u) = \frac{∂f_{int}}{∂u}.

UFL forms both derivatives symbolically (`datagen.solver.strain_energy`); FFCx compiles them to
C. Elements with a dilation θ have the energy Π(u, θ, p) of `datagen.discretisation.element`. Where
θ and p are unknowns, they are scaled to lengths, so that all unknowns are in m and all residuals in
N:

.. math:: θ = 1 + t / h, \qquad p = (λ + 2μ) \, q / h,

with the size h of the cells, the unknowns t and q in m, and the largest λ + 2μ of the materials at
rest.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import dolfinx
import numpy as np
import ufl
from numpy.typing import NDArray
from petsc4py import PETSc

from datagen.discretisation.element import ElementKind
from datagen.discretisation.element_loop import ElementLoop, Elimination, FormLoop, Kernel
from datagen.discretisation.unknowns import Unknowns
from datagen.dolfinx_versions import (
    COMPILER_OPTIONS,
    cell_kernels,
    form,
    mixed_space,
    pack_constants,
)
from datagen.solver.strain_energy import (
    Density,
    FibreField,
    Variations,
    deformation_gradient,
    density_of,
    longitudinal_modulus,
    variations,
    variations_between,
)
from shared_schema.materials import Material

NO_MODULI = "group", "density", "fibres"  # keys of a material that no energy depends on


@dataclass(frozen=True)
class Moduli:
    """Moduli of materials of one model, which differ in nothing else.

    Attributes
    ----------
    constants : sequence of dolfinx.fem.Constant
        Of the energy.
    values : array, (n_materials, n_constants)
    """

    constants: Sequence[Any]
    values: NDArray[np.float64]

    def kernels_of(self, compiled: Any) -> dict[int, Kernel]:
        """Kernels of the cells of each material: one function with other constants."""
        found = {}
        for part, values in enumerate(self.values):
            for constant, value in zip(self.constants, values, strict=True):
                constant.value = value
            (kernel,) = kernels_of(compiled).values()
            found[part] = Kernel(kernel.function, np.array(kernel.constants))
        return found


@dataclass(frozen=True)
class WeakForm:
    """Compiled forms of the state of a body on one mesh.

    Attributes
    ----------
    energy : dolfinx form
        E(u) or Π, a scalar in J.
    internal : dolfinx form
        f_int(u), a vector in N.
    tangent : dolfinx form
        K(u), a matrix in N/m.
    parts : array of int, (n_cells,), or None
        Material of each of this rank's own cells, if there are several.
    moduli : Moduli, or None
        Moduli of several materials of one model, whose cells share the kernels.
    eliminations : mapping from int to Elimination, or None
        What eliminates dilation and pressure in the cells of each material, if they are constant
        in each cell: the forms then have both beside the unknowns of the body.
    before : array, or None
        State at the last tangent of Newton's method, which those cells take their pressure from
        (`mean_dilation.c`).
    fibres : FibreField, or None
        Directions of the fibres of the materials.
    is_between : bool
        Forces are those between two states, of which `FormLoop.give` gives the first.
    """

    energy: Any
    internal: Any
    tangent: Any
    parts: NDArray[np.int64] | None = None
    moduli: Moduli | None = None
    eliminations: Mapping[int, Elimination] | None = None
    before: NDArray[np.float64] | None = None
    fibres: FibreField | None = None
    is_between: bool = False

    @property
    def first_given(self) -> int:
        """Column of what is given of a cell from which the first of two states is."""
        return 0 if self.fibres is None else self.fibres.values.shape[1]

    def loop(
        self,
        compiled: Any,
        unknowns: Unknowns,
        places: NDArray[np.int32],
        size: int,
        values: NDArray[np.float64] | None = None,
    ) -> FormLoop:
        """Loop over this rank's own cells that evaluates one of the forms."""
        given = None if self.fibres is None else self.fibres.values[: len(places)]
        if self.is_between:
            before = np.zeros(unknowns.cell_dofs.shape)
            given = before if given is None else np.concatenate([given, before], axis=1)
        return FormLoop(
            kernels_of(compiled) if self.moduli is None else self.moduli.kernels_of(compiled),
            unknowns.state,
            unknowns.cell_dofs,
            places,
            size,
            self.parts,
            self.eliminations,
            given,
            values,
        )


def weak_form(
    unknowns: Unknowns,
    kind: ElementKind,
    material: Material | Sequence[Material],
    size: float,
    parts: NDArray[np.int64] | None = None,
    fibres: FibreField | None = None,
    between: bool = False,
) -> WeakForm:
    """Derive and compile the forms (collective over the ranks of the mesh).

    Parameters
    ----------
    unknowns : Unknowns
        The forms are evaluated at the current values of its state.
    kind : ElementKind
    material : Material, or sequence of some
    size : float
        Size of the cells in m, the unit of dilations and pressures.
    parts : array of int, (n_local_cells,), optional
        Position of each cell's material in the sequence.
    fibres : FibreField, optional
        Directions of the fibres of the materials.
    between : bool
        Forces between two states (`variations_between`), of elements without a dilation of their
        own.
    """
    state = unknowns.state
    domain = state.function_space.mesh
    d = domain.geometry.dim
    dx = ufl.Measure("dx", domain, metadata={"quadrature_degree": kind.quadrature_degree})
    several = [(-1, material)] if isinstance(material, Material) else list(enumerate(material))
    # Coefficients of the directions and of the state before; made when the state exists.
    function = before = None

    def varied(f: Any, part: int, material: Material, dilation: Any = None) -> Variations:
        directions = [] if fibres is None else fibres.directions(function, max(part, 0))
        if before is not None:
            return variations_between(material, before, state, directions)
        return variations(density_of(f, material, domain, dilation, directions), state)

    own_parts = None
    measures = {-1: dx}
    if not isinstance(material, Material):
        assert parts is not None
        own_parts = parts[: len(unknowns.cell_dofs)]
        numbers = np.arange(len(parts), dtype=np.int32)
        of_cells = dolfinx.mesh.meshtags(
            domain, domain.topology.dim, numbers, parts.astype(np.int32)
        )
        of_parts = dx(subdomain_data=of_cells)
        measures = {part: of_parts(part) for part, _ in several}

    if kind.dilation == "cell":
        state = dolfinx.fem.Function(mixed_space(domain, kind.degree, d, ("DG", 0)))
    if fibres is not None:
        function = fibres.function()
    if between:
        before = dolfinx.fem.Function(state.function_space)
    if kind.dilation == "pointwise":
        f = deformation_gradient(state)
        if (
            not between
            and own_parts is not None
            and of_one_model([each for _, each in several], fibres)
        ):
            densities = [varied(f, part, each) for part, each in several]
            energies = [each.value * dx for each in densities]
            values = np.array([[float(c.value) for c in each.constants()] for each in energies])
            moduli = Moduli(energies[0].constants(), values)
            forms = _compiled([(densities[0], dx)])
            return WeakForm(*forms, own_parts, moduli, fibres=fibres)
        forms = _compiled([(varied(f, part, each), measures[part]) for part, each in several])
        return WeakForm(*forms, own_parts, fibres=fibres, is_between=between)
    if kind.dilation == "cell":
        u, dilation, pressure = ufl.split(state)
    else:
        u, t, q = ufl.split(state)
        modulus = max(longitudinal_modulus(m) for _, m in several)
        length = dolfinx.fem.Constant(domain, PETSc.ScalarType(size))
        scale = dolfinx.fem.Constant(domain, PETSc.ScalarType(modulus / size))
        dilation, pressure = 1 + t / length, scale * q
    f = deformation_gradient(u)
    j = ufl.det(f)
    bound = variations(Density(pressure * (j - dilation)), state)
    terms = [(varied(f, part, each, dilation), measures[part]) for part, each in several]
    forms = _compiled([*terms, *((bound, measures[part]) for part, _ in several)])
    if kind.dilation == "continuous":
        return WeakForm(*forms, own_parts, fibres=fibres)
    volumes, before = cell_volumes(unknowns, dx), unknowns.state.x.array.copy()
    (deformed,) = kernels_of(form(j * dx, COMPILER_OPTIONS)).values()
    eliminations = {
        part: Elimination(deformed, kernel, volumes, before)
        for part, kernel in kernels_of(forms[1]).items()
    }
    return WeakForm(*forms, own_parts, None, eliminations, before, fibres)


def of_one_model(materials: Sequence[Material], fibres: FibreField | None = None) -> bool:
    """True for materials that differ in their moduli alone, numbers that are not whole."""
    kinds = {
        (
            type(each),
            0 if fibres is None else fibres.counts[number],
            *((k, v) for k, v in each if not isinstance(v, float) and k not in NO_MODULI),
        )
        for number, each in enumerate(materials)
    }
    return len(kinds) == 1


def kernels_of(compiled: Any) -> dict[int, Kernel]:
    """Kernels of the cells of a compiled form, by part of the mesh."""
    constants = pack_constants(compiled)
    return {part: Kernel(each, constants) for part, each in cell_kernels(compiled).items()}


def cell_volumes(unknowns: Unknowns, dx: Any) -> NDArray[np.float64]:
    """Volumes of this rank's own cells, by a measure: (n_cells,) in m³ (in the plane m²)."""
    one = dolfinx.fem.Constant(unknowns.state.function_space.mesh, PETSc.ScalarType(1.0))
    (kernel,) = kernels_of(form(one * dx, COMPILER_OPTIONS)).values()
    count = len(unknowns.cell_dofs)
    places = np.arange(count, dtype=np.int32)[:, None]
    return ElementLoop(kernel, unknowns.state, unknowns.cell_dofs, places, count).run()


def _compiled(terms: Sequence[tuple[Variations, Any]]) -> tuple[Any, Any, Any]:
    """Energy, its first and its second derivative, compiled, from integrands and measures."""
    first, *others = terms
    integrals = [part * first[1] for part in first[0]]
    for each, measure in others:
        integrals = [
            integral + part * measure for integral, part in zip(integrals, each, strict=True)
        ]
    energy, internal, tangent = (form(each, COMPILER_OPTIONS) for each in integrals)
    return energy, internal, tangent
