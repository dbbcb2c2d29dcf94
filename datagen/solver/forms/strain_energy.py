r"""Strain energy densities in UFL: the Neo-Hookean one with its volumetric terms, and any other.

.. math::
    W(F) = \tfrac{\mu}{2} (I_c - 3 - 2 \ln J) + U(J), \qquad
    I_c = \operatorname{tr}(F^T F), \quad J = \det F

where F is the deformation gradient, (d, d), and W is in J per m³ of the undeformed body. The Lamé
parameters in Pa are

.. math:: \lambda = \frac{E\nu}{(1+\nu)(1-2\nu)}, \qquad \mu = \frac{E}{2(1+\nu)}.

The volumetric term U(J), `paper` or `quadratic`, is one of `shared_schema.materials`. In two
dimensions the state is plane strain: F is completed by :math:`F_{33} = 1`, so that
:math:`I_c = \operatorname{tr}(F^T F) + 1` and J is the determinant of the in-plane part.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import dolfinx
import ufl
from petsc4py import PETSc

from datagen.solver.forms.variations import Density
from shared_schema.materials import (
    VOLUMETRIC_TERMS,
    ZERO,
    FibreInvariants,
    Invariants,
    Material,
    NeoHookean,
    Scalar,
    Volumetric,
)

Expression = Any  # a UFL expression; ufl has no types


class _OfUfl:
    """The functions that an energy may use, of UFL expressions."""

    def ln(self, x: Scalar, /) -> Expression:
        return ufl.ln(x)

    def exp(self, x: Scalar, /) -> Expression:
        return ufl.exp(x)

    def positive(self, x: Scalar, /) -> Expression:
        return ufl.conditional(ufl.gt(x, -ZERO), x, 0.0)


UFL = _OfUfl()


def deformation_gradient(u: Expression) -> Expression:
    """Deformation gradient F = I + ∇u, (d, d), of a displacement u with d components."""
    return ufl.Identity(len(u)) + ufl.grad(u)


def strain_energy(
    f: Expression, lam: Expression, mu: Expression, volumetric: Volumetric
) -> Expression:
    """Strain energy density W(F) = μ/2 (I_c − 3 − 2 ln J) + U(J) in J/m³.

    Parameters
    ----------
    f : UFL tensor, (d, d)
        Deformation gradient; d = 2 means plane strain (F₃₃ = 1).
    lam, mu : UFL scalars
        Lamé parameters in Pa.
    volumetric : {"paper", "quadratic"}
        Name of U(J).
    """
    j = ufl.det(f)
    log_j = ufl.ln(j)
    out_of_plane = 3 - f.ufl_shape[0]  # F₃₃² = 1 in plane strain, nothing in 3D
    i_c = ufl.tr(f.T * f) + out_of_plane
    return mu / 2 * (i_c - 3 - 2 * log_j) + VOLUMETRIC_TERMS[volumetric].energy(lam, j, log_j)


def completed(f: Expression) -> Expression:
    """F in three dimensions: plane strain is completed by F₃₃ = 1."""
    if f.ufl_shape[0] == 3:
        return f
    return ufl.as_tensor([[f[0, 0], f[0, 1], 0], [f[1, 0], f[1, 1], 0], [0, 0, 1]])


def energy_density(
    f: Expression,
    material: Material,
    domain: Any,
    dilation: Expression | None = None,
    directions: Sequence[Expression] = (),
) -> Expression:
    """Strain energy density W(F) of any material in J/m³, as a UFL scalar (`density_of`)."""
    return density_of(f, material, domain, dilation, directions).value


def density_of(
    f: Expression,
    material: Material,
    domain: Any,
    dilation: Expression | None = None,
    directions: Sequence[Expression] = (),
) -> Density:
    """Strain energy density W(F) of any material; with a dilation θ, W((θ/J)^(1/d) F).

    The moduli of a material are constants of the form, so that two bodies of one model share
    the compiled code.

    Parameters
    ----------
    f : UFL tensor, (d, d)
        Deformation gradient; d = 2 means plane strain.
    material : Material
    domain : dolfinx.mesh.Mesh
    dilation : UFL scalar, optional
        θ, which takes the place of J (`element.py`).
    directions : sequence of UFL vectors
        Unit vectors of the families of fibres, with two components in the plane.
    """
    d, j = f.ufl_shape[0], ufl.det(f)
    squared = 1.0 if dilation is None else (dilation / j) ** (2 / d)
    if isinstance(material, NeoHookean) and dilation is None:
        lam = _constant(material.lame_lambda, domain)
        mu = _constant(material.lame_mu, domain)
        return Density(strain_energy(f, lam, mu, material.volumetric))
    numbers = {k: _constant(v, domain) for k, v in material if isinstance(v, float)}
    c, out_of_plane = f.T * f, 3 - d
    i1 = squared * ufl.tr(c) + out_of_plane
    i2 = (i1**2 - squared**2 * ufl.tr(c * c) - out_of_plane) / 2
    expressions = [i1, i2, j if dilation is None else dilation]
    for direction in directions:
        expressions += _along(direction, c, squared)
    x1, x2, x3, *rest = variables = [ufl.variable(x) for x in expressions]
    families = tuple(
        FibreInvariants(stretch, fifth - x1 * stretch + x2)
        for stretch, fifth in zip(rest[::2], rest[1::2], strict=True)
    )
    scaled = material.model_copy(update=numbers)
    return Density(scaled.energy(Invariants(x1, x2, x3, families), UFL), tuple(variables))


def _along(direction: Expression, c: Expression, squared: Expression) -> list[Expression]:
    """I₄ = a·C a and I₅ = |C a|², of C, (d, d), without the factor `squared`."""
    missing = c.ufl_shape[0] - len(direction)  # an axis that F was completed by
    a = ufl.as_vector([*(direction[i] for i in range(len(direction))), *(0.0,) * missing])
    row = ufl.dot(c, a)
    return [squared * ufl.dot(a, row), squared**2 * ufl.dot(row, row)]


def longitudinal_modulus(material: Material) -> float:
    """λ + 2μ = ∂²W/∂F₁₁² at rest in Pa."""
    return material.lame_lambda + 2 * material.lame_mu


def _constant(value: float, domain: Any) -> Expression:
    return dolfinx.fem.Constant(domain, PETSc.ScalarType(value))
