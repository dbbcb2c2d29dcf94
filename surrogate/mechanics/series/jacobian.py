r"""The determinant of the deformation gradient as a polynomial.

.. math::
    J(c) = \det (I + \sum_k c_k H_k) = 1 + \sum_m J_m p_m(c)

with the monomials pₘ of all degrees up to d. With H₀ = I and c₀ = 1 they are the products
:math:`c_k c_l` in the plane, and :math:`c_k c_l c_m` in space, k ≤ l ≤ m, without the first, whose
coefficients follow from one another:

.. math::
    J_{kl} = \tfrac{1}{r} \, \mathrm{cof} H_k : H_l, \qquad
    J_{klm} = \tfrac{1}{r} C_{kl} : H_m, \qquad
    C_{kk} = \mathrm{cof} H_k, \quad C_{kl} = H_k × H_l \; (k < l),

where the last index occurs r times (`surrogate.mechanics.series.cofactors`). So J and its
derivatives are products with one matrix, whatever c is.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from itertools import combinations_with_replacement, permutations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from surrogate.mechanics.series.arrays import constant, library_of, on_device_of
from surrogate.mechanics.series.cofactors import (
    cofactors,
    contraction,
    cross_product,
    linear_cofactors,
    trace,
)

Array = Any  # of NumPy, or a Tensor


class JacobianPolynomial:
    """J at points, and its derivatives with respect to c.

    Parameters
    ----------
    h : array, (…, n, d, d, n_points)
        Hₖ.

    Attributes
    ----------
    coefficients : array, (…, n_monomials, n_points)
        Jₘ.
    """

    def __init__(self, h: Array) -> None:
        self.library, self.degree, self.order = library_of(h), h.shape[-2], h.shape[-4]
        self.coefficients = self.library.concatenate(list(_coefficients(h)), -2)
        forms, curvatures = monomial_forms(self.order, self.degree)
        self.forms, self.curvatures = on_device_of(h, forms), on_device_of(h, curvatures)

    def monomials(self, c: Array) -> tuple[Array, Array, Array]:
        """Return pₘ, and the first and second derivatives.

        Parameters
        ----------
        c : array, (…, n)
            In double precision.

        Returns
        -------
        values : array, (…, n_monomials)
        slopes : array, (…, n, n_monomials)
        curvatures : array, (…, n_monomials, n²), or (n_monomials, n²) in the plane
        """
        d, size = self.degree, self.order + 1
        samples, count = c.shape[:-1], self.coefficients.shape[-2]
        column = self.library.concatenate((0 * c[..., :1] + 1, c), -1)[..., None]
        forms, curvatures = self.forms, self.curvatures
        if d == 3:
            forms = (forms @ column).reshape(*samples, count * size, size)
            curvatures = (curvatures @ column).reshape(*samples, count, self.order**2)
        slopes = (forms @ column).reshape(*samples, count, size)
        values = (slopes @ column)[..., 0]
        return values, d * slopes[..., 1:].swapaxes(-1, -2), curvatures


@cache
def monomial_forms(order: int, degree: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Monomials as symmetric forms of 1, c₁, …, cₙ, and their second derivatives.

    Returns
    -------
    forms : array, (n_monomials · (n + 1)^(d - 1), n + 1)
    curvatures : array, (n_monomials, n²) in the plane; (n_monomials · n², n + 1) in space
        What gives the second derivatives, multiplied by 1, c₁, …, cₙ in space.
    """
    monomials = list(combinations_with_replacement(range(order + 1), degree))[1:]
    forms = np.zeros((len(monomials), *(order + 1,) * degree))
    for form, indices in zip(forms, monomials, strict=True):
        places = set(permutations(indices))
        for place in places:
            form[place] = 1 / len(places)
    curvatures = degree * (degree - 1) * forms[:, 1:, 1:].reshape(len(forms), order**2, -1)
    last = (len(forms), order**2) if degree == 2 else (-1, order + 1)
    return forms.reshape(-1, order + 1), np.ascontiguousarray(curvatures.reshape(last))


def _coefficients(h: Array) -> Iterator[Array]:
    """Coefficients of monomials that differ in the last index: (…, n_monomials, n_points) each."""
    yield trace(h)
    if h.shape[-2] == 2:  # small arrays: one call for all pairs
        rows, columns, factors = _pairs(h.shape[-4])
        products = contraction(linear_cofactors(h)[..., rows, :, :, :], h[..., columns, :, :, :])
        yield constant(factors, h) * products
        return
    first = range(h.shape[-4])
    of = [h[..., k, :, :, :] for k in first]
    for k in first:
        yield _with_later(linear_cofactors(of[k]), h, k, 2)
    for k in first:
        yield _with_later(cofactors(of[k]), h, k, 3)
        for m in first[k + 1 :]:
            yield _with_later(cross_product(of[k], of[m]), h, m, 2)


@cache
def _pairs(order: int) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]:
    """All pairs k ≤ l, and 1/r, (n_pairs, 1)."""
    k, m = np.triu_indices(order)
    return k, m, np.where(k == m, 0.5, 1.0)[:, None]


@cache
def _first_divided(count: int, occurrences: int) -> NDArray[np.float64]:
    """1/r and ones: (count, 1)."""
    return np.where(np.arange(count) == 0, 1 / occurrences, 1.0)[:, None]


def _with_later(product: Array, h: Array, start: int, occurrences: int) -> Array:
    """Contractions with H of `start`, which then occurs so often, and with those after it."""
    values = contraction(product[..., None, :, :, :], h[..., start:, :, :, :])
    values *= constant(_first_divided(values.shape[-2], occurrences), values)
    return values
