r"""Cofactors of deformation gradients, and the rotations of their polar decompositions F = R U.

Arrays have the two axes of a tensor first, (d, d, …), so that every operation runs over all points.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

STEPS = {2: 1, 3: 3}  # of Newton's method; in the plane one step is exact

Values = NDArray[np.floating[Any]]


def cofactors(f: Values) -> Values:
    """Cofactors ∂J/∂F: (d, d, …) → same."""
    if len(f) == 2:
        return np.stack([np.stack([f[1, 1], -f[1, 0]]), np.stack([-f[0, 1], f[0, 0]])])
    result, following = np.empty_like(f), (1, 2, 0, 1)
    for a in range(3):
        b, c = f[following[a]], f[following[a + 1]]
        for i in range(3):
            j, k = following[i], following[i + 1]
            result[a, i] = b[j] * c[k] - b[k] * c[j]
    return result


def rotations(f: Values) -> Values:
    """Rotations R of the polar decompositions F = R U, nearly: (d, d, …) → same.

    Newton's method for R (Higham 1986), :math:`R ← (R + R^{-T}) / 2`, with the determinant scaled
    to 1 before each step, and after the last one; three steps in space. Where det F is not positive
    the rotation is none.
    """
    d, r = len(f), f
    for _ in range(STEPS[d]):
        r = unimodular(r)
        r = (r + cofactors(r)) / 2
    r = unimodular(r)
    identity = np.eye(d, dtype=f.dtype).reshape(d, d, *[1] * (f.ndim - 2))
    return np.where(np.isfinite(r).all((0, 1)), r, identity)


def unimodular(f: Values) -> Values:
    """F / (det F)^(1/d): (d, d, …) → same, NaN where det F is not positive."""
    j = (f[0] * cofactors(f)[0]).sum(0)
    j = np.where(j > 0, j, np.nan)
    return f / (np.sqrt(j) if len(f) == 2 else np.cbrt(j))
