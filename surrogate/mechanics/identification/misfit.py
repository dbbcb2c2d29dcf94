r"""Whether what a fit leaves of the markers is noise.

Of n numbers with normal noise of a given σ, a right model of p parameters leaves

.. math:: \frac{1}{σ^2} \sum_m |r_m|^2 \sim χ^2_{n - p}.

A noise that was estimated from the same :math:`r_m` says nothing of their size. But noise is
without order, whereas a wrong model leaves neighbours alike:

.. math:: I = \sum_m r_m · \sum_{j \in N(m)} r_j

over the nearest neighbours of each marker (Moran 1950, *Biometrika* 37) is then larger than nearly
all values that it has with the same :math:`r_m` in another order. A relative error of the whole
field (`surrogate.mechanics.identification.least_squares`) leaves next to nothing of either.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree
from scipy.stats import chi2

Array = NDArray[np.float64]

SUSPECT = 0.01  # probability under which what is left is no noise
NEIGHBOURS = 3
ORDERS = 999
FEW = 8  # markers that tell no order


def noise_probability(x: Array, left: Array, parameters: int, sigma: float | None) -> float:
    """Probability that noise leaves as much, or what is as much in order.

    Parameters
    ----------
    x, left : array, (m, d)
        Markers at rest that count, and what a fit leaves of their displacements, in m.
    parameters : int
        Number p of parameters.
    sigma : float or None
        Given noise of a component in m.
    """
    order = 1.0 if len(x) < FEW else order_probability(x, left)
    if sigma is None:
        return order
    size = float(chi2.sf((left**2).sum() / sigma**2, left.size - parameters))
    return min(2 * min(size, order), 1.0)  # of two tests (Bonferroni)


def order_probability(x: Array, left: Array) -> float:
    """Part of random orders, and the present one, that have neighbours as much alike."""
    _, near = KDTree(x).query(x, NEIGHBOURS + 1)
    rng = np.random.default_rng(0)
    orders = np.array([np.arange(len(x)), *(rng.permutation(len(x)) for _ in range(ORDERS))])
    ordered = left[orders]  # (orders, m, d)
    alike = np.einsum("omd,omkd->o", ordered, ordered[:, near[:, 1:]])
    return float((alike >= alike[0] * (1 - 1e-12)).mean())
