r"""A reduced cubature: few quadrature points with weights for integrals over a body in modes.

.. math::
    \sum_{q ∈ Q} w_q \, ∇V_q^T : P_q(a_s) ≈ \sum_{\text{all } q} v_q \, ∇V_q^T : P_q(a_s), \qquad
    w_q \ge 0

for states :math:`a_s` of the body: the internal forces in modes, and the body's volume, are those
of the whole mesh. Both sides are multiplied by the inverse of the stiffness at the state, so that
their difference is what the cubature does to the displacement. Points are added one after the
other, those that are most parallel to what is left over, with non-negative least squares for the
weights (Farhat, Avery, Chapman and Cortial 2014; Hernández, Caicedo and Ferrer 2017). A few random
combinations of the equations of every state take their place.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

Array = NDArray[np.float64]
FEWEST, SHARE = 10, 0.05  # points that are added between two solves, and part of all
STUCK = 15  # solves without a further point, after which there is none


class Cubature(NamedTuple):
    """Points of a cubature.

    Attributes
    ----------
    cells, points : array of int, (n,)
        Cell, and number of the quadrature point in it.
    weights : array, (n,)
        In m³.
    """

    cells: NDArray[np.int64]
    points: NDArray[np.int64]
    weights: Array


def fit_cubature(columns: Array, total: Array, count: int) -> tuple[NDArray[np.int64], Array]:
    """Choose columns whose sum with non-negative factors is closest to a total.

    Parameters
    ----------
    columns : array, (n_equations, n_columns)
    total : array, (n_equations,)
    count : int
        Number of columns that are chosen, at most.

    Returns
    -------
    chosen : array of int, (n,)
    factors : array, (n,)
        Positive.
    """
    lengths = np.linalg.norm(columns, axis=0)
    lengths[lengths == 0] = np.inf
    at_once = max(FEWEST, int(SHARE * count))
    chosen, factors, left, stuck = np.empty(0, np.int64), np.empty(0), total, 0
    while len(chosen) < count and stuck < STUCK and len(chosen) < columns.shape[1]:
        gain = columns.T @ left / lengths
        gain[chosen] = -np.inf
        more = np.argsort(-gain)[: min(1 if stuck else at_once, count - len(chosen))]
        tried = np.concatenate([chosen, more[gain[more] > 0]])
        if len(tried) == len(chosen):
            break
        q, r = np.linalg.qr(columns[:, tried])
        found, _ = nnls(r, q.T @ total, maxiter=30 * len(tried))
        stuck = stuck + 1 if np.count_nonzero(found) <= len(chosen) else 0
        chosen, factors = tried[found > 0], found[found > 0]
        left = total - columns[:, chosen] @ factors
    return chosen, factors
