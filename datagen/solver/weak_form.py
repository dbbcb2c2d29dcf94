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

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import dolfinx
import numpy as np
import ufl
from numpy.typing import NDArray

from datagen.dolfinx_versions import COMPILER_OPTIONS, form
from datagen.solver.material import deformation_gradient, energy_density
from shared_schema.material import Material

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


def weak_form(
    u: Any,
    material: Material | Sequence[Material],
    parts: NDArray[np.int64] | None = None,
) -> WeakForm:
    """Derive and compile the forms (collective over the ranks of the mesh).

    Parameters
    ----------
    u : dolfinx.fem.Function
        Displacement in m, P1 or Q1 vectors. The forms are evaluated at its current values.
    material : Material, or sequence of some
    parts : array of int, (n_local_cells,), optional
        Position of each cell's material in the sequence.

    Raises
    ------
    InputError
        If the energy of a user's own material is none.
    """
    domain = u.function_space.mesh
    dx = ufl.Measure("dx", domain, metadata={"quadrature_degree": QUADRATURE_DEGREE})
    f = deformation_gradient(u)
    if isinstance(material, Material):
        energy = energy_density(f, material, domain) * dx
    else:
        assert parts is not None
        numbers = np.arange(len(parts), dtype=np.int32)
        of_cells = dolfinx.mesh.meshtags(
            domain, domain.topology.dim, numbers, parts.astype(np.int32)
        )
        dx = dx(subdomain_data=of_cells)
        first, *others = (energy_density(f, m, domain) * dx(i) for i, m in enumerate(material))
        energy = sum(others, start=first)
    internal = ufl.derivative(energy, u)
    tangent = ufl.derivative(internal, u)
    return WeakForm(*(form(each, COMPILER_OPTIONS) for each in (energy, internal, tangent)))
