r"""Solutions with a tangent by conjugate gradients, where its factors would take long.

.. math:: K x = b, \qquad ‖b - K x‖_P \le ε ‖b‖_P, \qquad ‖y‖_P^2 = y · P y, \quad P ≈ K^{-1}

(Nocedal and Wright, *Numerical Optimization*, 2006, Algorithm 5.3), with a P that is symmetric and
positive definite. Since P may be in single precision, directions follow Polak and Ribière, whose
rule bears its rounding errors better than that of Fletcher and Reeves.

The iterations tell as well whether K is positive definite, if b is random. The residual is
:math:`b - K x = q(K P) \, b` with a polynomial q whose zeros are Ritz values and whose value at 0
is 1. As long as no direction p has :math:`p · K p \le 0`, all zeros are positive, so that
:math:`q(λ) > 1` for every λ < 0: the part of b along such an eigenvector of K P does not decrease.
Where the whole residual falls to ε of b, K has a negative eigenvalue only if the part of b along
it was smaller than that by chance. In the norm of P, soft directions make up most of b. SciPy's
``cg`` looks neither at :math:`p · K p` nor at this norm.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from surrogate.mechanics.matrices.sparse_matrix import Solver, SparseLayout, has_pardiso
from surrogate.mechanics.matrices.stiffness_layout import Layout

Array = NDArray[np.float64]
Operator = Callable[[Array], Array]
ACCURACY = 1e-6  # ε
MOST = 60  # iterations; a factor takes as long as some hundred


def iterates(layout: Layout) -> bool:
    """Whether iterations solve with a tangent sooner than its factors: a large body's, by SuperLU.

    On 20 000 nodes a full certificate takes 14 s by iterations, 33 s by factors of SuperLU, and 6 s
    by those of PARDISO (``docs/benchmarks/tangents.md``).
    """
    return type(layout) is SparseLayout and not has_pardiso()


class Iterations:
    """What solves with a tangent by conjugate gradients.

    Parameters
    ----------
    product, preconditioner : callable
        K and P, (n,) → (n,).
    size : int
        n.
    factorised : callable
        Makes the factors of K, for right-hand sides that take too many iterations; None if it is
        not positive definite.
    """

    def __init__(
        self,
        product: Operator,
        preconditioner: Operator,
        size: int,
        factorised: Callable[[], Solver | None],
    ) -> None:
        self._product, self._preconditioner, self._size = product, preconditioner, size
        self._factorised = factorised

    def is_definite(self) -> bool:
        """Whether K is positive definite; False as well if that takes too many iterations."""
        random = np.random.default_rng(0).normal(size=self._size)
        return conjugate_gradients(self._product, self._preconditioner, random) is not None

    def solve(self, right: NDArray[Any]) -> NDArray[Any]:
        """K⁻¹ f: (n,) or (n, m) → same; NaN where f is, or neither way leads to it."""
        found = np.empty_like(right)
        for column, result in zip(np.atleast_2d(right.T), np.atleast_2d(found.T), strict=True):
            result[:] = self._solved(column)
        return found

    def _solved(self, right: Array) -> Array:
        found = conjugate_gradients(self._product, self._preconditioner, right)
        if found is not None:
            return found
        return np.full_like(right, np.nan) if self._factor is None else self._factor.solve(right)

    @cached_property
    def _factor(self) -> Solver | None:
        return self._factorised()


def conjugate_gradients(product: Operator, preconditioner: Operator, b: Array) -> Array | None:
    """Solve K x = b: (n,) → (n,); None if K is not positive definite, or after `MOST` iterations.

    Parameters
    ----------
    product, preconditioner : callable
        K and P, (n,) → (n,).
    b : array, (n,)
        The solution of one with a NaN is NaN.
    """
    x, r, z = np.zeros_like(b), b, preconditioner(b)
    p, square = z, float(r @ z)
    enough = ACCURACY**2 * square
    if not np.isfinite(square):
        return np.full_like(b, np.nan)
    for _ in range(MOST):
        if square <= enough:
            return x
        q = product(p)
        curvature = float(p @ q)
        if not curvature > 0:
            return None
        step, last = square / curvature, r
        x, r = x + step * p, r - step * q
        z = preconditioner(r)
        p, square = z + float(z @ (r - last)) / square * p, float(r @ z)
    return None
