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

The variations of an energy follow by the chain rule through its invariants. With the invariants
:math:`x_k(u)` of an energy density :math:`W(x_1, x_2, …)`, and :math:`δ` and :math:`Δ` the
variations by test and trial functions,

.. math::
    δW = \sum_k \frac{∂W}{∂x_k} \, δx_k, \qquad
    Δ δW = \sum_{kl} \frac{∂^2 W}{∂x_k ∂x_l} \, δx_k \, Δx_l
           + \sum_k \frac{∂W}{∂x_k} \, Δ δx_k .

The derivatives of W are scalars without arguments. UFL would carry test and trial functions through
every operation of W instead, which takes FFCx minutes where a formula is long (Ogden's).

Between two states u and u' the energy changes by exactly the work of the stress (Gonzalez 2000,
*Comput. Methods Appl. Mech. Engrg.* 190)

.. math::
    S = 2 W_C(C_½) + 2 \frac{W(C') - W(C) - W_C(C_½) : ΔC}{ΔC : ΔC} \, ΔC, \qquad
    C_½ = \tfrac12 (C + C'), \quad ΔC = C' - C,

on the strains :math:`\operatorname{sym}(F_½^T ∇v)`, :math:`F_½ = (F + F') / 2`: it conserves
energy and momenta. Where C changes by less than `SAME`, the second term is left out: it is of third
order, and rounding errors of W over a small change would keep Newton's method from its tolerance.
The tangent lacks its derivative, which is of second order in ΔC.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import dolfinx
import numpy as np
import ufl
from numpy.typing import NDArray
from petsc4py import PETSc
from ufl.algorithms.apply_algebra_lowering import apply_algebra_lowering
from ufl.algorithms.apply_derivatives import apply_derivatives
from ufl.constantvalue import Zero

from datagen.dolfinx_versions import cell_blocks, functionspace
from datagen.mesh.distributed_mesh import Mesh
from shared_schema.common.errors import InputError
from shared_schema.materials import (
    VOLUMETRIC_TERMS,
    ZERO,
    FibreInvariants,
    Invariants,
    Material,
    NeoHookean,
    Scalar,
    Volumetric,
    WithFibres,
)

Expression = Any  # a UFL expression; ufl has no types
SAME = 3e-4  # of C: change below which rounding spoils a difference of energies


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
    directions: Sequence[Expression] = (),
) -> Expression:
    """Strain energy density W(F) of any material in J/m³, as a UFL scalar (`density_of`)."""
    return density_of(f, material, domain, directions=directions).value


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
    scaled = material.model_copy(update=numbers)
    return _of_strain(f.T * f, j if dilation is None else dilation, scaled, directions, squared)


def _of_strain(
    c: Expression,
    j: Expression,
    material: Material,
    directions: Sequence[Expression],
    squared: Expression = 1.0,
) -> Density:
    """W of C, (d, d), times a factor, and of J; the moduli of the material may be expressions."""
    out_of_plane = 3 - c.ufl_shape[0]
    i1 = squared * ufl.tr(c) + out_of_plane
    i2 = (i1**2 - squared**2 * ufl.tr(c * c) - out_of_plane) / 2
    expressions = [i1, i2, j]
    for direction in directions:
        expressions += _along(direction, c, squared)
    x1, x2, x3, *rest = variables = [ufl.variable(x) for x in expressions]
    families = tuple(
        FibreInvariants(stretch, fifth - x1 * stretch + x2)
        for stretch, fifth in zip(rest[::2], rest[1::2], strict=True)
    )
    return Density(material.energy(Invariants(x1, x2, x3, families), UFL), tuple(variables))


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


@dataclass(frozen=True)
class FibreField:
    """Directions of the fibres of all families, constant in each cell.

    Attributes
    ----------
    mesh : Mesh
    values : array, (n_local_cells, families · d)
        Unit vectors of the cells of this rank, ghosts included; 0 for a family that a cell lacks.
    counts : tuple of int
        Number of families of each material.
    """

    mesh: Mesh
    values: NDArray[np.float64]
    counts: tuple[int, ...]

    def function(self) -> Any:
        """Make a UFL coefficient of all vectors, after those that exist."""
        space = functionspace(self.mesh.domain, ("DG", 0, (self.values.shape[1],)))
        function = dolfinx.fem.Function(space, name="fibres")
        width = self.values.shape[1]
        blocks = cell_blocks(space)[:, 0]
        function.x.array.reshape(-1, width)[blocks] = self.values
        return function

    def directions(self, function: Any, material: int) -> list[Any]:
        """Unit vectors of the families of a material, as UFL vectors with d components."""
        d = self.mesh.coordinates.shape[1]
        return [
            ufl.as_vector([function[family * d + i] for i in range(d)])
            for family in range(self.counts[material])
        ]


def fibre_field(
    mesh: Mesh,
    materials: Sequence[Material],
    parts: NDArray[np.int64] | None,
    fibres: NDArray[np.float64] | None,
) -> FibreField | None:
    """Distribute the directions of fibres; None if no material has any.

    Parameters
    ----------
    mesh : Mesh
    materials : sequence of Material
    parts : array of int, (n_cells,), or None
        Position of each cell's material; all are of the first by default.
    fibres : array, (n_cells, families, d), or None
        Unit vectors in the undeformed body.

    Raises
    ------
    InputError
        If a material has another number of families than its energy takes.
    """
    of_cells = np.zeros(len(mesh.cells), dtype=np.int64) if parts is None else parts
    none = np.zeros((len(mesh.cells), 0))
    there = none if fibres is None else np.linalg.norm(fibres, axis=2) > 0
    counts = []
    for number, material in enumerate(materials):
        own = there[of_cells == number]
        fewest, most = material.family_range if isinstance(material, WithFibres) else (0, 0)
        count = min(int(own.all(axis=0).sum()), most) if len(own) else fewest
        if count < fewest:
            raise InputError(
                f"material '{material.model}': every cell has {count} directions of fibres, "
                f"expected {fewest} at least"
            )
        counts.append(count)
    if fibres is None or not any(counts):
        return None
    local = mesh.of_local_cells(fibres)
    return FibreField(mesh, local.reshape(len(local), -1), tuple(counts))


class Density(NamedTuple):
    """Strain energy density, as a UFL expression of variables.

    Attributes
    ----------
    value : UFL scalar
        W in J/m³.
    invariants : tuple of UFL variables
        x_k; none of an energy whose variations UFL derives itself.
    """

    value: Expression
    invariants: tuple[Expression, ...] = ()


class Variations(NamedTuple):
    """A scalar of a state with its variations, to be integrated.

    Attributes
    ----------
    value, first, second : UFL scalars
        Without arguments, with a test function, and with test and trial function.
    """

    value: Expression
    first: Expression
    second: Expression


def variations(density: Density, state: Any) -> Variations:
    """Derive the variations of an energy density by a state, a dolfinx.fem.Function."""
    space = state.function_space
    test, trial = ufl.TestFunction(space), ufl.TrialFunction(space)
    if not density.invariants:
        first = ufl.derivative(density.value, state, test)
        return Variations(density.value, first, ufl.derivative(first, state, trial))
    terms, first, second = [], [], []
    for variable in density.invariants:
        slope = _plain(ufl.diff(density.value, variable))
        if isinstance(slope, Zero):
            continue
        of_test, of_trial = (ufl.derivative(variable, state, v) for v in (test, trial))
        first.append(slope * of_test)
        second.append(slope * ufl.derivative(of_test, state, trial))
        terms.append((variable, slope, of_test, of_trial))
    for variable, _, _, of_trial in terms:
        for _, slope, of_test, _ in terms:
            curvature = _plain(ufl.diff(slope, variable))
            if not isinstance(curvature, Zero):
                second.append(curvature * of_test * of_trial)
    return Variations(density.value, sum(first[1:], first[0]), sum(second[1:], second[0]))


def variations_between(
    material: Material, before: Any, state: Any, directions: Sequence[Expression] = ()
) -> Variations:
    """Forces between two states, functions of one space, as variations of the energy of the last.

    `second` is the derivative of `first` by the last state but for what is of second order in the
    change of strains.
    """
    space = state.function_space
    test, trial = ufl.TestFunction(space), ufl.TrialFunction(space)
    domain = space.mesh
    numbers = {k: _constant(v, domain) for k, v in material if isinstance(v, float)}
    scaled = material.model_copy(update=numbers)
    f, last = deformation_gradient(before), deformation_gradient(state)
    c, middle = (f.T * f, last.T * last), (f + last) / 2
    change, half = c[1] - c[0], ufl.variable((c[0] + c[1]) / 2)
    ends = [_of_strain(each, ufl.sqrt(ufl.det(each)), scaled, directions).value for each in c]
    density = _of_strain(half, ufl.sqrt(ufl.det(half)), scaled, directions)
    growth = middle.T * ufl.grad(test)
    growth = growth + growth.T  # δC
    first, second, rest, terms = [], [], ends[1] - ends[0], []
    for variable in density.invariants:
        slope = _plain(ufl.diff(density.value, variable))
        if isinstance(slope, Zero):
            continue
        by_strain = _plain(ufl.diff(variable.ufl_operands[0], half))
        of_test = ufl.inner(by_strain, growth)
        rest = rest - slope * ufl.inner(by_strain, change)
        first.append(slope * of_test)
        second.append(slope * ufl.derivative(of_test, state, trial))
        terms.append((variable, slope, of_test, ufl.derivative(variable, state, trial)))
    for variable, _, _, of_trial in terms:
        for _, slope, of_test, _ in terms:
            curvature = _plain(ufl.diff(slope, variable))
            if not isinstance(curvature, Zero):
                second.append(curvature * of_test * of_trial)
    square = ufl.inner(change, change)
    changes = ufl.gt(square, SAME**2)
    factor = ufl.conditional(changes, rest / ufl.conditional(changes, square, 1.0), 0.0)
    first.append(factor * ufl.inner(change, growth))
    second.append(factor * ufl.derivative(ufl.inner(change, growth), state, trial))
    return Variations(ends[1], sum(first[1:], first[0]), sum(second[1:], second[0]))


def _plain(derivative: Expression) -> Expression:
    """Carry out the derivatives in an expression."""
    return apply_derivatives(apply_algebra_lowering(derivative))
