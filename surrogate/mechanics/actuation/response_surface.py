r"""Polynomials of several variables, of the least squares of values and slopes at some points.

.. math:: y(x) = \sum_{|k| \le n} c_k \, x^k, \qquad
   \min_c \; \sum_i \|y(x_i) - y_i\|^2 + \sum_{i, j} \|∂y/∂x_j(x_i) - y_{i,j}\|^2

(Myers, Montgomery and Anderson-Cook, *Response surface methodology*, 2016). Slopes of a solution
cost little beside the solution; with those by m variables, a point gives 1 + m equations.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import combinations_with_replacement

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
EQUATIONS = 2  # for every coefficient, at least
HIGHEST = 6  # degree
CUT = 1e-10  # of the singular values


@dataclass(frozen=True)
class ResponseSurface:
    """A polynomial with values of k components.

    Attributes
    ----------
    variables : int
    coefficients : array, (n_terms, k)
        Those of the products of the variables, the shorter ones first.
    """

    variables: int
    coefficients: Array

    @classmethod
    def fit(
        cls, x: Array, values: Array, slopes: Array | None = None, highest: int = HIGHEST
    ) -> ResponseSurface:
        """Fit the polynomial of the highest degree that the data determine, up to some degree.

        Parameters
        ----------
        x : array, (n, m)
            Points, of the size 1.
        values : array, (n, k)
        slopes : array, (n, m, k), optional
        """
        m = x.shape[1]
        right = values if slopes is None else np.concatenate([values, *slopes.transpose(1, 0, 2)])
        degree = max(n for n in range(highest + 1) if points_of(m, n) <= max(len(right), 2))
        surface = cls(m, np.zeros((_count(m, degree), values.shape[1])))
        rows = [np.array([surface.terms(each) for each in x])]
        if slopes is not None:
            rows += list(np.array([surface.slopes_of_terms(each) for each in x]).transpose(1, 0, 2))
        return cls(m, np.linalg.lstsq(np.concatenate(rows), right, rcond=CUT)[0])

    def at(self, x: Array) -> Array:
        """Values: (m,) → (k,)."""
        return np.asarray(self.terms(x) @ self.coefficients)

    def slopes(self, x: Array) -> Array:
        """Derivatives by the variables: (m,) → (m, k)."""
        return np.asarray(self.slopes_of_terms(x) @ self.coefficients)

    def terms(self, x: Array) -> Array:
        """The products of the variables, (n_terms,)."""
        return np.asarray(np.prod(x**self._powers, axis=1))

    def slopes_of_terms(self, x: Array) -> Array:
        """Their derivatives, (m, n_terms)."""
        found = np.empty((self.variables, len(self._powers)))
        for j in range(self.variables):
            lower = self._powers.copy()
            lower[:, j] = np.maximum(lower[:, j] - 1, 0)
            found[j] = self._powers[:, j] * np.prod(x**lower, axis=1)
        return found

    @cached_property
    def _powers(self) -> NDArray[np.int64]:
        """Exponents, (n_terms, m)."""
        found: list[NDArray[np.int64]] = []
        degree = 0
        while len(found) < len(self.coefficients):
            for factors in combinations_with_replacement(range(self.variables), degree):
                found.append(np.bincount(factors, minlength=self.variables))
            degree += 1
        return np.array(found, dtype=np.int64).reshape(-1, self.variables)


def points_of(variables: int, degree: int) -> int:
    """How many values determine a polynomial well."""
    return EQUATIONS * _count(variables, degree)


def _count(variables: int, degree: int) -> int:
    """Number of the products of at most so many factors."""
    count = 1
    for k in range(1, degree + 1):
        count = count * (variables + k) // k
    return count
