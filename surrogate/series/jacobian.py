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

where the last index occurs r times (`surrogate.series.cofactors`). So J and its
derivatives are products with one matrix, whatever c is.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from itertools import combinations_with_replacement, permutations
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from surrogate.series.cofactors import (
    cofactors,
    contraction,
    cross_product,
    linear_cofactors,
    trace,
)


class JacobianPolynomial(NamedTuple):
    """J at points, and its derivatives with respect to c.

    Attributes
    ----------
    coefficients : Tensor, (…, n_monomials, n_points)
        Jₘ.
    forms, curvatures : Tensor
        Of `monomial_forms`.
    """

    coefficients: Tensor
    forms: Tensor
    curvatures: Tensor

    @classmethod
    def of(cls, h: Tensor) -> JacobianPolynomial:
        """Return that of the gradients Hₖ, (…, n, d, d, n_points)."""
        forms = monomial_forms(h.shape[-4], h.shape[-2])
        on_device = [torch.from_numpy(each).to(h.device) for each in forms]
        return cls(torch.cat(list(_coefficients(h)), -2), *on_device)

    def some(self, rows: Tensor) -> JacobianPolynomial:
        """Return the polynomials of some rows of a batch."""
        return self._replace(coefficients=self.coefficients[rows])

    def monomials(self, c: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Return pₘ, and the first and second derivatives.

        Parameters
        ----------
        c : Tensor, (…, n)
            In double precision.

        Returns
        -------
        values : Tensor, (…, n_monomials)
        slopes : Tensor, (…, n, n_monomials)
        curvatures : Tensor, (…, n_monomials, n²), or (n_monomials, n²) in the plane
        """
        samples, order, count = c.shape[:-1], c.shape[-1], self.coefficients.shape[-2]
        d, size = 2 if len(self.curvatures) == count else 3, order + 1
        column = torch.cat((torch.ones_like(c[..., :1]), c), -1)[..., None]
        forms, curvatures = self.forms, self.curvatures
        if d == 3:
            forms = (forms @ column).reshape(*samples, count * size, size)
            curvatures = (curvatures @ column).reshape(*samples, count, order**2)
        slopes = (forms @ column).reshape(*samples, count, size)
        values = (slopes @ column)[..., 0]
        return values, d * slopes[..., 1:].mT, curvatures


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


def _coefficients(h: Tensor) -> Iterator[Tensor]:
    """Coefficients of monomials that differ in the last index: (…, n_monomials, n_points) each."""
    yield trace(h)
    first = range(h.shape[-4])
    of = [h[..., k, :, :, :] for k in first]
    for k in first:
        yield _with_later(linear_cofactors(of[k]), h, k, 2)
    if h.shape[-2] == 2:
        return
    for k in first:
        yield _with_later(cofactors(of[k]), h, k, 3)
        for m in first[k + 1 :]:
            yield _with_later(cross_product(of[k], of[m]), h, m, 2)


def _with_later(product: Tensor, h: Tensor, start: int, occurrences: int) -> Tensor:
    """Contractions with H of `start`, which then occurs so often, and with those after it."""
    values = contraction(product[..., None, :, :, :], h[..., start:, :, :, :])
    return torch.cat((values[..., :1, :] / occurrences, values[..., 1:, :]), -2)
