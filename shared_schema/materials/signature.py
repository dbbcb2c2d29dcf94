r"""What a strain energy is a function of, and the functions that it may use.

.. math:: I_1 = \operatorname{tr} C, \qquad I_2 = \tfrac12 (I_1^2 - \operatorname{tr} C^2), \qquad
          J = \det F, \qquad C = F^T F,

with the deformation gradient F, (3, 3); plane strain has :math:`F_{33} = 1`, so that
:math:`I_2 = I_1 - 1 + J^2`. A family of fibres with the direction a, a unit vector of the
undeformed body, adds

.. math:: I_4 = |F a|^2 = a \cdot C a, \qquad K_4 = |\operatorname{cof}(F) \, a|^2
          = a \cdot \operatorname{cof}(C) \, a = I_5 - I_1 I_4 + I_2, \qquad I_5 = a \cdot C^2 a .

An energy is written with ``+ - * /``, ``**`` with constant exponents, and `Functions`, and with
nothing else: UFL expressions, tensors, arrays, symbols, power series and jets
(`shared_schema.materials.jet`) can be put in.
"""

from __future__ import annotations

from typing import Any, NamedTuple, Protocol, TypeAlias

import numpy as np

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
