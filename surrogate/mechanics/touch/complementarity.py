r"""Linear complementarity problems, of contact: which nodes bear a force, and which are apart.

.. math:: w = A λ + q, \qquad w \ge 0, \quad λ \ge 0, \quad λ^T w = 0
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
BLOCKS = 5  # exchanges of many unknowns that may bring no progress
MOST = 300  # exchanges at all


def solve_complementarity(matrix: Array, offset: Array, begins: NDArray[np.bool_]) -> Array | None:
    """Solve by block principal pivoting (Portugal, Júdice and Vicente 1994, *Math. Comp.* 63).

    All unknowns on the wrong side are exchanged at once; where that makes no progress, only the
    last of them, which always ends for matrices of positive principal minors (Murty 1974).

    Parameters
    ----------
    matrix, offset : array, (n, n) and (n,)
        A and q.
    begins : array of bool, (n,)
        Unknowns that are not 0 at first.

    Returns
    -------
    array, (n,), or None
        λ; None if no solution is found.
    """
    inside, best, left = begins.copy(), len(offset) + 1, BLOCKS
    slack = 1e-12 * max(float(np.abs(offset).max(initial=0.0)), 1e-300)
    for _ in range(MOST):
        found = np.zeros(len(offset))
        part = np.flatnonzero(inside)
        try:
            found[part] = np.linalg.solve(matrix[np.ix_(part, part)], -offset[part])
        except np.linalg.LinAlgError:
            return None
        apart = matrix @ found + offset
        wrong = np.flatnonzero(np.where(inside, found < 0, apart < -slack))
        if not len(wrong):
            return found
        if len(wrong) < best:
            best, left = len(wrong), BLOCKS
        elif left:
            left -= 1
        else:
            wrong = wrong[-1:]
        inside[wrong] = ~inside[wrong]
    return None
