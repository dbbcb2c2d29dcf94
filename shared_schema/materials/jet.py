r"""Derivatives of an energy to second order, by the arithmetic of jets.

A jet is the value, the gradient g and the Hessian H of a function of n variables at one point:

.. math:: f(x) = f + g \cdot (x - x_0) + \tfrac12 (x - x_0) \cdot H (x - x_0) + O(|x - x_0|^3) .

The sum, the product and the functions of jets are those of such polynomials, cut off after second
order; so an energy that is given jets returns its own derivatives.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shared_schema.materials.signature import ZERO

Array = NDArray[np.float64]


class Jet:
    """Value, gradient and Hessian of a function of n variables at a point.

    Parameters
    ----------
    value : float
    gradient : array, (n,)
    hessian : array, (n, n)
    """

    __array_ufunc__ = None  # a NumPy scalar leaves the arithmetic to the jet

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

    __radd__, __rmul__ = __add__, __mul__

    def __neg__(self) -> Jet:
        return -1.0 * self

    def __pos__(self) -> Jet:
        return self

    def __sub__(self, other: Any) -> Jet:
        return self + -other

    def __rsub__(self, other: Any) -> Jet:
        return -self + other

    def __truediv__(self, other: Any) -> Jet:
        return self * (other**-1 if isinstance(other, Jet) else 1.0 / other)

    def __rtruediv__(self, other: Any) -> Jet:
        return other * self**-1

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
