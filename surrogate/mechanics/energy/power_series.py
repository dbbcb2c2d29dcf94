r"""Power series of fields of scalars and tensors, whose coefficients follow from those of F.

.. math::
    F = \sum_k s^k F_k, \qquad (A B)_k = \sum_{j=0}^k A_j B_{k-j}, \qquad
    (a^c)_k = \frac{1}{a_0} \sum_{j=1}^k \left(\frac{(c + 1) j}{k} - 1\right) a_j \, (a^c)_{k-j},

    (\exp a)_k = \sum_{j=1}^k \frac jk \, a_j (\exp a)_{k-j}, \qquad
    (\ln a)_k = \frac{1}{a_0} \left(a_k - \sum_{j=1}^{k-1} \frac jk \, (\ln a)_j a_{k-j}\right)

for every product that is linear in both (D. E. Knuth, *The Art of Computer Programming* 2, Section
4.7). The coefficient of order 1 is the derivative along :math:`F_1`. Where F₀ is the unit tensor,
those of order 0 are multiples of it, and numbers.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any, TypeAlias

import numpy as np
import torch
from torch import Tensor

from surrogate.mechanics.energy.recording import exp, is_zero, log, step

Coefficient: TypeAlias = Any  # a tensor, (…) or (d, d, …), a `Spherical` one, or a number; 0.0
NUMBER = int | float
Product: TypeAlias = Callable[[Coefficient, Coefficient], Coefficient]


class Spherical:
    """A multiple c I of the unit tensor.

    Parameters
    ----------
    factor : number or tensor, (…)
        c.
    unit : tensor, (d, d, 1, …)
        I.
    """

    def __init__(self, factor: Coefficient, unit: Tensor) -> None:
        self.factor, self.unit = factor, unit

    def __len__(self) -> int:
        return len(self.unit)

    def __add__(self, other: Any) -> Any:
        if isinstance(other, Spherical):
            return Spherical(self.factor + other.factor, self.unit)
        return other + self.factor * self.unit

    def __mul__(self, other: Coefficient) -> Spherical:
        return Spherical(other * self.factor, self.unit)

    __radd__, __rmul__ = __add__, __mul__


class Given:
    """The coefficients of F as far as they are known; those of higher order are zero.

    Parameters
    ----------
    first : Coefficient, (d, d, …)
        F₀.
    """

    def __init__(self, first: Coefficient) -> None:
        self.terms, self._changes = [first], [0]

    def set(self, k: int, term: Tensor) -> None:
        """Set Fₖ of an order that is known, or the next one."""
        self.terms[k:] = [term]
        self._changes[k:] = [self.version(k) + 1]

    def version(self, k: int) -> int:
        """A number that changes with what coefficients of order k depend on."""
        return sum(self._changes[: k + 1])

    def series(self) -> Series:
        """F itself."""
        return Series(self, lambda _, k: self.terms[k] if k < len(self.terms) else 0.0)


class Series:
    """A power series whose coefficients are computed when they are asked for.

    Parameters
    ----------
    given : Given
        What they depend on.
    coefficient : callable
        That of an order, of this series and the order.
    """

    def __init__(self, given: Given, coefficient: Callable[[Series, int], Coefficient]) -> None:
        self.given, self._coefficient = given, coefficient
        self._known: dict[int, tuple[int, Coefficient]] = {}

    def __len__(self) -> int:
        return len(self.given.terms[0])

    def term(self, k: int) -> Coefficient:
        """The coefficient of order k."""
        version = self.given.version(k)
        if k not in self._known or self._known[k][0] != version:
            self._known[k] = version, self._coefficient(self, k)
        return self._known[k][1]

    def mapped(self, function: Callable[[Coefficient], Coefficient]) -> Series:
        """A linear function of the series."""

        def coefficient(_: Series, k: int) -> Coefficient:
            a = self.term(k)
            return a if is_zero(a) else function(a)

        return Series(self.given, coefficient)

    def sum_of_products(self, terms: Sequence[tuple[Any, Any, float]]) -> Series:
        """Σ f a b of pairs and factors, of series or numbers."""
        return _summed(self.given, None, terms)

    def __add__(self, other: Any) -> Series:
        return _summed(self.given, None, [(1.0, self, 1.0), (1.0, other, 1.0)])

    def __mul__(self, other: Any) -> Series:
        return _summed(self.given, None, [(self, other, 1.0)])

    __radd__, __rmul__ = __add__, __mul__

    def __rtruediv__(self, other: float) -> Series:
        return other * self**-1

    def __pow__(self, c: float) -> Series:
        def coefficient(y: Series, k: int) -> Coefficient:
            a = self.term(0)
            if k == 0:
                return 1 / a if c == -1 else a**c
            weights = [(c + 1) * j / k - 1 for j in range(k + 1)]
            return _quotient(_convolved(None, self, y, k, range(1, k + 1), weights), a)

        return Series(self.given, coefficient)

    def exp(self) -> Series:
        """Exponential function."""

        def coefficient(y: Series, k: int) -> Coefficient:
            if k == 0:
                return exp(self.term(0))
            weights = [j / k for j in range(k + 1)]
            return _convolved(None, self, y, k, range(1, k + 1), weights)

        return Series(self.given, coefficient)

    def log(self) -> Series:
        """Natural logarithm."""

        def coefficient(y: Series, k: int) -> Coefficient:
            a = self.term(0)
            if k == 0:
                return log(a)
            weights = [-j / k for j in range(k)]
            return _quotient(_convolved(None, y, self, k, range(1, k), weights, self.term(k)), a)

        return Series(self.given, coefficient)

    def step(self) -> Series:
        """1 where the series is not negative, else 0."""
        return Series(self.given, lambda _, k: step(self.term(0)) if k == 0 else 0.0)

    def guarded(self, is_good: Callable[[Coefficient], Any]) -> Series:
        """The same with 1 in place of a number of order 0 that is not good."""

        def coefficient(_: Series, k: int) -> Coefficient:
            a = self.term(k)
            return torch.where(is_good(a), a, 1.0) if k == 0 and isinstance(a, Tensor) else a

        return Series(self.given, coefficient)


def product(function: Product, a: Any, b: Any, factor: float = 1.0) -> Any:
    """A multiple of a product that is linear in both, of series, or of one and something fixed."""
    if isinstance(a, Series) and isinstance(b, Series):
        return _summed(a.given, function, [(a, b, factor)])
    if isinstance(b, Series):
        return b.mapped(lambda each: factor * function(a, each))
    if isinstance(a, Series):
        return a.mapped(lambda each: factor * function(each, b))
    return function(a, b) if factor == 1 else factor * function(a, b)


def _summed(
    given: Given, function: Product | None, terms: Sequence[tuple[Any, Any, float]]
) -> Series:
    """Σ f a b of products of series; a number stands for one whose higher terms are zero."""
    inner: dict[int, Coefficient] = {}  # of what is known before the terms of an order

    def convolved(k: int, orders: Iterable[int], total: Coefficient = 0.0) -> Coefficient:
        for a, b, c in terms:
            total = _convolved(function, a, b, k, orders, [c] * (k + 1), total)
        return total

    def coefficient(_: Series, k: int) -> Coefficient:
        if k not in inner:
            inner.clear()
            inner[k] = convolved(k, range(1, k))
        if k and any(isinstance(_term(b, 0), Spherical) for _, b, _ in terms):  # added up first
            return _added(convolved(k, [0], inner[k]), convolved(k, [k]))
        return convolved(k, [0, k] if k else [0], inner[k])

    return Series(given, coefficient)


def _convolved(
    function: Product | None,
    a: Any,
    b: Any,
    k: int,
    orders: Iterable[int],
    weights: Sequence[float],
    total: Any = 0.0,
) -> Coefficient:
    """Add Σ wⱼ aⱼ bₖ₋ⱼ of some orders j to a total; of a square, both of a pair at once."""
    for j in orders:
        w = weights[j] if a is not b or 2 * j == k else 2 * weights[j] * (2 * j > k)
        x = _term(a, j) if w else 0.0
        y = x if is_zero(x) else _term(b, k - j)
        if is_zero(y):
            continue
        total = _plus(total, w, 1.0, function(x, y)) if function else _plus(total, w, x, y)
    return total


def _plus(total: Coefficient, w: float, x: Coefficient, y: Coefficient) -> Coefficient:
    """A sum and w x y, in one pass over tensors."""
    if isinstance(y, NUMBER):
        x, y = y, x
    if isinstance(x, NUMBER):
        w, x = w * x, None
    if isinstance(total, Tensor) and isinstance(y, Tensor):
        return torch.add(total, y, alpha=w) if x is None else torch.addcmul(total, x, y, value=w)
    part = y if x is None else x * y
    return _added(total, part if w == 1 else w * part)


def _term(a: Any, k: int) -> Coefficient:
    return a.term(k) if isinstance(a, Series) else a if k == 0 else 0.0


def _added(a: Coefficient, b: Coefficient) -> Coefficient:
    return b if is_zero(a) else a if is_zero(b) else a + b


def _quotient(a: Coefficient, b: Coefficient) -> Coefficient:
    return a if is_zero(a) or (isinstance(b, float) and b == 1) else a / b


def unit_tensor(like: Any) -> Any:
    """The unit tensor: (d, d, 1, …), of a tensor or an array."""
    if not isinstance(like, Tensor):
        return np.eye(len(like))
    found = torch.eye(len(like), dtype=like.dtype, device=like.device)
    return found.reshape(*found.shape, *(1 for _ in like.shape[2:]))
