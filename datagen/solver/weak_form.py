r"""Weak form of equilibrium: strain energy, internal forces and tangent stiffness.

A body occupies :math:`Ω` at rest. Under the displacement :math:`u` its strain energy is

.. math:: E(u) = \int_Ω W(F) \, dV, \qquad F = I + ∇u,

with the energy density W of `datagen.solver.material`. The internal forces are the derivative of
the energy, the tangent stiffness is the derivative of the internal forces:

.. math::
    f_{int}(u)·v = \frac{dE}{du}[v] = \int_Ω P(F) : ∇v \, dV, \quad P = \frac{∂W}{∂F},
    \qquad K(u) = \frac{∂f_{int}}{∂u}.

UFL forms both derivatives symbolically; FFCx compiles them to C. Displacements are linear (P1) on
triangles and tetrahedra, bi- or trilinear (Q1) on quadrilaterals and hexahedra.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import dolfinx
import ufl
from petsc4py import PETSc

from datagen.dolfinx_versions import COMPILER_OPTIONS, form
from datagen.solver.material import deformation_gradient, strain_energy
from shared_schema.material import NeoHookean

QUADRATURE_DEGREE = 2  # 2 Gauss points along each axis of a quadrilateral or hexahedron


@dataclass(frozen=True)
class WeakForm:
    """Compiled forms of one displacement function on one mesh.

    Attributes
    ----------
    energy : dolfinx form
        E(u), a scalar in J.
    internal : dolfinx form
        f_int(u), a vector in N.
    tangent : dolfinx form
        K(u), a matrix in N/m.
    """

    energy: Any
    internal: Any
    tangent: Any


def weak_form(u: Any, material: NeoHookean) -> WeakForm:
    """Derive and compile the forms (collective over the ranks of the mesh).

    Parameters
    ----------
    u : dolfinx.fem.Function
        Displacement in m, P1 or Q1 vectors. The forms are evaluated at its current values.
    material : NeoHookean
    """
    domain = u.function_space.mesh
    lam = dolfinx.fem.Constant(domain, PETSc.ScalarType(material.lame_lambda))
    mu = dolfinx.fem.Constant(domain, PETSc.ScalarType(material.lame_mu))
    dx = ufl.Measure("dx", domain, metadata={"quadrature_degree": QUADRATURE_DEGREE})
    f = deformation_gradient(u)
    energy = strain_energy(f, lam, mu, material.volumetric) * dx
    internal = ufl.derivative(energy, u)
    tangent = ufl.derivative(internal, u)
    return WeakForm(*(form(each, COMPILER_OPTIONS) for each in (energy, internal, tangent)))
