r"""Cofactors of deformation gradients, and the rotations of their polar decompositions F = R U.

Arrays, of NumPy or PyTorch, have the two axes of a tensor first, (d, d, …), so that every operation
runs over all points. Functions of NumPy and PyTorch that have the same name do the same.
"""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
from numpy.typing import NDArray


def library_of(values: Any) -> Any:
    """NumPy of an array, PyTorch of a tensor."""
    return np if isinstance(values, np.ndarray) else sys.modules["torch"]


STEPS = {2: 1, 3: 3}  # of Newton's method; in the plane one step is exact

Values = NDArray[np.floating[Any]]


def cofactors(f: Values) -> Values:
    """Cofactors ∂J/∂F: (d, d, …) → same."""
    result, following = library_of(f).empty_like(f), (1, 2, 0, 1)
    if len(f) == 2:
        result[0, 0], result[1, 1] = f[1, 1], f[0, 0]
        result[0, 1], result[1, 0] = -f[1, 0], -f[0, 1]
        return result
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
    d, r, library = len(f), f, library_of(f)
    for _ in range(STEPS[d]):
        r = unimodular(r)
        r = (r + cofactors(r)) / 2
    r = unimodular(r)
    known = library.isfinite(r).all((0, 1))
    r = library.where(known, r, 0)
    for i in range(d):
        r[i, i] = library.where(known, r[i, i], 1)
    return r


def unimodular(f: Values) -> Values:
    """F / (det F)^(1/d): (d, d, …) → same, NaN where det F is not positive."""
    j = (f[0] * cofactors(f)[0]).sum(0)
    library = library_of(j)
    j = library.where(j > 0, j, np.nan)
    if len(f) == 2:
        return f / library.sqrt(j)
    return f / (np.cbrt(j) if library is np else j ** (1 / 3))
