r"""Base of all materials: a strain energy of invariants, and its stress and stiffness at rest.

.. math:: I_1 = \operatorname{tr} C, \qquad I_2 = \tfrac12 (I_1^2 - \operatorname{tr} C^2), \qquad
          J = \det F, \qquad C = F^T F,

with the deformation gradient F, (3, 3); plane strain has :math:`F_{33} = 1`, so that
:math:`I_2 = I_1 - 1 + J^2`. A family of fibres with the direction a, a unit vector of the
undeformed body, adds

.. math:: I_4 = |F a|^2 = a \cdot C a, \qquad K_4 = |\operatorname{cof}(F) \, a|^2
          = a \cdot \operatorname{cof}(C) \, a = I_5 - I_1 I_4 + I_2, \qquad I_5 = a \cdot C^2 a .

An energy is written with ``+ - * /``, ``**`` with constant exponents, and `Functions`, and with
nothing else: UFL expressions, tensors, arrays, symbols, power series and jets can be put in.

A jet is the value, the gradient g and the Hessian H of a function of n variables at one point:

.. math:: f(x) = f + g \cdot (x - x_0) + \tfrac12 (x - x_0) \cdot H (x - x_0) + O(|x - x_0|^3) .

The sum, the product and the functions of jets are those of such polynomials, cut off after second
order; so an energy that is given jets returns its own derivatives.

With the invariants :math:`x_k`, :math:`C = I + 2 E` and :math:`ψ_k = ∂W/∂x_k` at rest, stress and
stiffness of the undeformed body are

.. math::
    S[H] = \sum_k ψ_k \, x_k'[H], \qquad
    \mathbb{C}[H, H] = \sum_{kl} ψ_{kl} \, x_k'[H] \, x_l'[H] + \sum_k ψ_k \, x_k''[H, H],

and the derivatives of the invariants by E along a symmetric H are

.. math::
    I_1' = 2 \operatorname{tr} H, \qquad I_2' = 4 \operatorname{tr} H, \qquad
    J' = \operatorname{tr} H, \qquad I_4' = 2 ε, \qquad K_4' = 2 (\operatorname{tr} H - ε), \\
    I_2'' = 4 (\operatorname{tr} H)^2 - 4 H:H, \qquad
    J'' = (\operatorname{tr} H)^2 - 2 H:H, \\
    K_4'' = 8 |H a|^2 - 8 ε \operatorname{tr} H + 4 (\operatorname{tr} H)^2 - 4 H:H, \qquad
    ε = a \cdot H a .

For an isotropic energy :math:`\mathbb{C}` has the Lamé parameters
:math:`μ = 2 (ψ_1 + ψ_2)`, without stress. All families of fibres are taken to lie along one
direction a, in which they are stiffest together. Marsden and Hughes, Mathematical Foundations of
Elasticity (1983), sections 3.2 and 4.1.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from shared_schema.common.configuration import Frozen, absent
from shared_schema.common.errors import first_line

ZERO = 1e-12  # `positive` takes numbers above −ZERO for positive: at rest fibres bear, to rounding
Scalar: TypeAlias = Any  # a float, a UFL expression, an array, a tensor, a jet


class FibreInvariants(NamedTuple):
    """Invariants of C and the direction of a family of fibres.

    Attributes
    ----------
    stretch : scalar
        I₄ = a·C a, the square of the stretch along the fibres.
    area : scalar
        K₄ = a·cof(C) a, the square of the change of an area across them.
    """

    stretch: Scalar
    area: Scalar

    def fifth(self, i1: Scalar, i2: Scalar) -> Scalar:
        """I₅ = a·C² a = I₁ I₄ − I₂ + K₄."""
        return i1 * self.stretch - i2 + self.area


class Invariants(NamedTuple):
    """Invariants of C, and of C and the directions of fibres.

    Attributes
    ----------
    i1, i2, j : scalar
        I₁, I₂ and J; 3, 3 and 1 at rest.
    fibres : tuple of FibreInvariants
        One for each family; both numbers are 1 at rest.
    """

    i1: Scalar
    i2: Scalar
    j: Scalar
    fibres: tuple[FibreInvariants, ...] = ()


class Functions(Protocol):
    """Functions of one scalar that an energy may use."""

    def ln(self, x: Scalar, /) -> Scalar:
        """Natural logarithm."""

    def exp(self, x: Scalar, /) -> Scalar:
        """Exponential function."""

    def positive(self, x: Scalar, /) -> Scalar:
        """Return max(x, 0), of slope 1 at 0: x where x > −`ZERO`, else 0."""


class _OfArrays:
    """The functions of arrays and of numbers."""

    def ln(self, x: Scalar, /) -> Scalar:
        return np.log(x)

    def exp(self, x: Scalar, /) -> Scalar:
        return np.exp(x)

    def positive(self, x: Scalar, /) -> Scalar:
        return np.where(np.greater(x, -ZERO), x, 0.0)


ARRAYS: Functions = _OfArrays()


Array = NDArray[np.float64]


class Arithmetic(ABC):
    """Operations that follow from sum, product and power, with numbers as well."""

    __array_ufunc__ = None  # a NumPy scalar leaves the arithmetic to this

    @abstractmethod
    def __add__(self, other: Any) -> Any: ...

    @abstractmethod
    def __mul__(self, other: Any) -> Any: ...

    @abstractmethod
    def __pow__(self, exponent: float) -> Any: ...

    def __radd__(self, other: Any) -> Any:
        return self + other

    def __rmul__(self, other: Any) -> Any:
        return self * other

    def __neg__(self) -> Any:
        return self * -1.0

    def __pos__(self) -> Any:
        return self

    def __sub__(self, other: Any) -> Any:
        return self + -other

    def __rsub__(self, other: Any) -> Any:
        return -self + other

    def __truediv__(self, other: Any) -> Any:
        return self * (other**-1 if isinstance(other, Arithmetic) else 1.0 / other)

    def __rtruediv__(self, other: Any) -> Any:
        return self**-1 * other


class Jet(Arithmetic):
    """Value, gradient and Hessian of a function of n variables at a point.

    Parameters
    ----------
    value : float
    gradient : array, (n,)
    hessian : array, (n, n)
    """

    def __init__(self, value: float, gradient: Array, hessian: Array) -> None:
        self.value, self.gradient, self.hessian = float(value), gradient, hessian

    @classmethod
    def variables(cls, *values: float) -> list[Jet]:
        """Jets of the variables themselves at a point."""
        count = len(values)
        rows = np.eye(count)
        return [cls(x, rows[i], np.zeros((count, count))) for i, x in enumerate(values)]

    def constant(self, value: float) -> Jet:
        """Jet of a constant function of the same variables."""
        return Jet(value, np.zeros_like(self.gradient), np.zeros_like(self.hessian))

    def of(self, value: float, first: float, second: float) -> Jet:
        """Jet of a function of this one, from its value and its derivatives there."""
        outer = np.outer(self.gradient, self.gradient)
        return Jet(value, first * self.gradient, first * self.hessian + second * outer)

    def __add__(self, other: Any) -> Jet:
        if isinstance(other, Jet):
            return Jet(
                self.value + other.value,
                self.gradient + other.gradient,
                self.hessian + other.hessian,
            )
        return Jet(self.value + other, self.gradient, self.hessian)

    def __mul__(self, other: Any) -> Jet:
        if isinstance(other, Jet):
            mixed = np.outer(self.gradient, other.gradient)
            return Jet(
                self.value * other.value,
                self.value * other.gradient + other.value * self.gradient,
                self.value * other.hessian + other.value * self.hessian + mixed + mixed.T,
            )
        return Jet(other * self.value, other * self.gradient, other * self.hessian)

    def __pow__(self, exponent: float) -> Jet:
        x, p = self.value, exponent
        first = p * x ** (p - 1) if p else 0.0
        second = p * (p - 1) * x ** (p - 2) if p * (p - 1) else 0.0
        return self.of(x**p, first, second)


class _OfJets:
    """The functions of jets."""

    def ln(self, x: Any, /) -> Any:
        if not isinstance(x, Jet):
            return math.log(x)
        return x.of(math.log(x.value), 1 / x.value, -1 / x.value**2)

    def exp(self, x: Any, /) -> Any:
        if not isinstance(x, Jet):
            return math.exp(x)
        value = math.exp(x.value)
        return x.of(value, value, value)

    def positive(self, x: Any, /) -> Any:
        if not isinstance(x, Jet):
            return x if x > -ZERO else 0.0
        return x if x.value > -ZERO else x.constant(0.0)


JETS = _OfJets()


Energy = Callable[[Invariants, Functions], Scalar]
STRESS_FREE = 1e-9  # largest stress at rest, over the stiffness
SMALLEST = 1e-12  # least eigenvalue of the stiffness, scaled to a diagonal of ones; rounding: 1e-15


class AtRest(NamedTuple):
    """Stress and stiffness of the undeformed body in Pa.

    Attributes
    ----------
    stress : array, (6,)
        On the orthonormal basis of symmetric tensors of `_basis`: five that preserve the volume,
        and I/√3.
    stiffness : array, (6, 6)
        ℂ on the same basis.
    """

    stress: Array
    stiffness: Array

    @property
    def shear_modulus(self) -> float:
        """μ in Pa, of the stiffest strain that preserves the volume: 2 μ is its stiffness."""
        return float(np.linalg.eigvalsh(self.stiffness[:5, :5])[-1]) / 2

    @property
    def bulk_modulus(self) -> float:
        """K = I:ℂ:I / 9 in Pa."""
        return float(self.stiffness[5, 5]) / 3

    def problem(self) -> str | None:
        """Say why this is no solid at rest, if it is none."""
        if not (np.isfinite(self.stress).all() and np.isfinite(self.stiffness).all()):
            return "the energy has no value, or no stiffness, in the undeformed body"
        stress, scale = np.abs(self.stress).max(), np.abs(self.stiffness).max()
        if stress > STRESS_FREE * scale:
            return f"the undeformed body is under a stress of {stress:g} Pa, expected none"
        shear = float(np.linalg.eigvalsh(self.stiffness[:5, :5])[0]) / 2
        for name, modulus in (("shear", shear), ("bulk", self.bulk_modulus)):
            if not modulus > 0:
                return f"the {name} modulus at rest is {modulus:g} Pa, expected above 0"
        root = np.sqrt(np.diag(self.stiffness))
        least = float(np.linalg.eigvalsh(self.stiffness / np.outer(root, root))[0])
        if not least > SMALLEST:
            return "a small strain costs no energy, expected a positive definite stiffness at rest"
        return None


def at_rest(energy: Energy, families: int) -> AtRest:
    """Derive stress and stiffness at rest from an energy of some families of fibres.

    Raises
    ------
    ArithmeticError, ValueError
        If the energy has no value there.
    """
    i1, i2, j, *rest = Jet.variables(3.0, 3.0, 1.0, *(1.0,) * (2 * families))
    fibres = tuple(FibreInvariants(*rest[2 * k : 2 * k + 2]) for k in range(families))
    w = energy(Invariants(i1, i2, j, fibres), JETS)
    psi = w if isinstance(w, Jet) else i1.constant(w)
    first, second = _derivatives(families)
    stiffness = first.T @ psi.hessian @ first + np.tensordot(psi.gradient, second, 1)
    return AtRest(psi.gradient @ first, (stiffness + stiffness.T) / 2)


def _basis() -> Array:
    """Orthonormal symmetric tensors, (6, 3, 3): five without a trace, then I/√3."""
    pairs = [np.diag([1.0, -1.0, 0.0]), np.diag([1.0, 1.0, -2.0])]
    for i, k in ((0, 1), (0, 2), (1, 2)):
        shear = np.zeros((3, 3))
        shear[i, k] = shear[k, i] = 1.0
        pairs.append(shear)
    return np.stack([h / np.linalg.norm(h) for h in [*pairs, np.eye(3)]])


@cache
def _derivatives(families: int) -> tuple[Array, Array]:
    """x_k' and x_k'' on the basis: (n_invariants, 6) and (n_invariants, 6, 6)."""
    basis = _basis()
    trace = np.trace(basis, axis1=1, axis2=2)
    trace[:5] = 0.0
    traces, squares, nothing = np.outer(trace, trace), np.eye(6), np.zeros((6, 6))
    along = basis[:, 0, 0]  # ε for a = (1, 0, 0)
    across = basis[:, 0] @ basis[:, 0].T
    mixed = np.outer(along, trace)
    area = 8 * across - 4 * (mixed + mixed.T) + 4 * traces - 4 * squares
    first = [2 * trace, 4 * trace, trace] + [2 * along, 2 * (trace - along)] * families
    second = [nothing, 4 * (traces - squares), traces - 2 * squares] + [nothing, area] * families
    return np.stack(first), np.stack(second)


LARGEST_MODULUS = 1e18  # Pa
LARGEST_DENSITY = 1e12  # kg/m³


class Material(Frozen, ABC):
    """A hyperelastic material; its attributes are the keys of a case's ``material`` section.

    Attributes
    ----------
    model : str
        Name of the model, or ``FILE.py:ClassName`` of a user's own one.
    group : str or None
        Physical group of the cells that are of this material, if a body has several.
    density : float or None
        Mass of the undeformed body over its volume in kg/m³, which motion needs.
    """

    model: str
    group: str | None = Field(None, min_length=1, exclude_if=absent)
    density: float | None = Field(None, gt=0, le=LARGEST_DENSITY, exclude_if=absent)

    @abstractmethod
    def energy(self, c: Invariants, of: Functions) -> Scalar:
        """W in J per m³ of the undeformed body.

        Parameters
        ----------
        c : Invariants
            Of C and of the fibres; the isotropic ones are `c.i1`, `c.i2` and `c.j`.
        of : Functions
            `of.ln`, `of.exp` and `of.positive`; other functions are not known to all that is put
            in (`shared_schema.materials.material`).
        """

    @property
    def family_count(self) -> int:
        """Number of families of fibres."""
        return 0

    def _key_problem(self) -> str | None:
        """Say which key is wrong beside the others, before the energy is evaluated."""
        return None

    def at_rest(self) -> AtRest:
        """Stress and stiffness of the undeformed body, from the energy."""
        return at_rest(self.energy, self.family_count)

    @property
    def lame_mu(self) -> float:
        """Shear modulus μ of the undeformed body in Pa; with fibres, of the stiffest shear."""
        return self.at_rest().shear_modulus

    @property
    def lame_lambda(self) -> float:
        """First Lamé parameter λ = K − 2/3 μ of the undeformed body in Pa."""
        rest = self.at_rest()
        return rest.bulk_modulus - 2 / 3 * rest.shear_modulus

    @model_validator(mode="after")
    def _is_a_solid_at_rest(self) -> Material:
        if (problem := self._key_problem()) is not None:
            raise ValueError(problem)
        try:
            problem = self.at_rest().problem()
        except (ArithmeticError, ValueError) as error:
            problem = f"energy: {first_line(error)}"
        if problem is not None:
            known = {"model", "model_sha256", "group", "density", "recorded"}
            keys = ", ".join(f"{key} = {value}" for key, value in self if key not in known)
            raise ValueError(f"key 'model' = '{self.model}': {problem} ({keys})")
        return self
