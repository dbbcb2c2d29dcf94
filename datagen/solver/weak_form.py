r"""Weak form of equilibrium: strain energy, internal forces and tangent stiffness.

A body occupies :math:`Ω` at rest. Under the displacement :math:`u` its strain energy is

.. math:: E(u) = \int_Ω W(F) \, dV, \qquad F = I + ∇u,

with the energy density W of `datagen.solver.material`. The internal forces are the derivative of
the energy, the tangent stiffness is the derivative of the internal forces:

.. math::
    f_{int}(u)·v = \frac{dE}{du}[v] = \int_Ω P(F) : ∇v \, dV, \quad P = \frac{∂W}{∂F},
    \qquad K(u) = \frac{∂f_{int}}{∂u}.

UFL forms both derivatives symbolically; FFCx compiles them to C. Elements with a dilation θ have
the energy Π(u, θ, p) of `datagen.discretisation.element`. Where θ and p are unknowns, they are
scaled to lengths, so that all unknowns are in m and all residuals in N:

.. math:: θ = 1 + t / h, \qquad p = (λ + 2μ) \, q / h,

with the size h of the cells and the unknowns t and q in m.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import dolfinx
import numpy as np
import ufl
from numpy.typing import NDArray
from petsc4py import PETSc

from datagen.discretisation.element import ElementKind
from datagen.discretisation.element_loop import ElementLoop, Elimination, Kernel
from datagen.discretisation.unknowns import Unknowns
from datagen.dolfinx_versions import cell_kernel, form, mixed_space, pack_constants
from datagen.solver.material import deformation_gradient, strain_energy
from shared_schema.material import NeoHookean

COMPILER_OPTIONS = {"cffi_extra_compile_args": ["-O3"]}  # no -ffast-math: NaN must stay NaN


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
    elimination : Elimination or None
        What eliminates dilation and pressure, if they are constant in each cell: the forms then
        have both beside the unknowns of the body.
    """

    energy: Any
    internal: Any
    tangent: Any
    elimination: Elimination | None = None


def weak_form(unknowns: Unknowns, kind: ElementKind, material: NeoHookean, size: float) -> WeakForm:
    """Derive and compile the forms (collective over the ranks of the mesh).

    Parameters
    ----------
    unknowns : Unknowns
        The forms are evaluated at the current values of its state.
    kind : ElementKind
    material : NeoHookean
    size : float
        Size of the cells in m, the unit of dilations and pressures.
    """
    state = unknowns.state
    domain = state.function_space.mesh
    d = domain.geometry.dim

    def constant(value: float) -> Any:
        return dolfinx.fem.Constant(domain, PETSc.ScalarType(value))

    lam, mu = constant(material.lame_lambda), constant(material.lame_mu)
    dx = ufl.Measure("dx", domain, metadata={"quadrature_degree": kind.quadrature_degree})

    def density(f: Any) -> Any:
        return strain_energy(f, lam, mu, material.volumetric)

    if kind.dilation == "pointwise":
        energy = density(deformation_gradient(state)) * dx
        return WeakForm(*_derivatives(energy, state))
    if kind.dilation == "cell":
        state = dolfinx.fem.Function(mixed_space(domain, kind.degree, d, ("DG", 0)))
        u, dilation, pressure = ufl.split(state)
    else:
        u, t, q = ufl.split(state)
        modulus = material.lame_lambda + 2 * material.lame_mu
        dilation = 1 + t / constant(size)
        pressure = constant(modulus / size) * q
    f = deformation_gradient(u)
    j = ufl.det(f)
    energy = (density((dilation / j) ** (1 / d) * f) + pressure * (j - dilation)) * dx
    forms = _derivatives(energy, state)
    if kind.dilation == "continuous":
        return WeakForm(*forms)
    return WeakForm(*forms, Elimination(kernel_of(forms[1]), cell_volumes(unknowns, dx)))


def kernel_of(compiled: Any) -> Kernel:
    """Kernel of the cells of a compiled form."""
    return Kernel(cell_kernel(compiled), pack_constants(compiled))


def cell_volumes(unknowns: Unknowns, dx: Any) -> NDArray[np.float64]:
    """Volumes of this rank's own cells, by a measure: (n_cells,) in m³ (in the plane m²)."""
    one = dolfinx.fem.Constant(unknowns.state.function_space.mesh, PETSc.ScalarType(1.0))
    volume = form(one * dx, COMPILER_OPTIONS)
    count = len(unknowns.cell_dofs)
    places = np.arange(count, dtype=np.int32)[:, None]
    loop = ElementLoop(kernel_of(volume), unknowns.state, unknowns.cell_dofs, places, count)
    return loop.run()


def _derivatives(energy: Any, state: Any) -> tuple[Any, Any, Any]:
    """Energy, its first and its second derivative, compiled."""
    internal = ufl.derivative(energy, state)
    tangent = ufl.derivative(internal, state)
    return tuple(form(each, COMPILER_OPTIONS) for each in (energy, internal, tangent))
