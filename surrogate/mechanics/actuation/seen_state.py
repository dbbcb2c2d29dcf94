r"""What markers tell of parameters that drift, frame by frame (Kalman 1960).

Each parameter x wanders about 0 by :math:`\sqrt{P_0}` within a time T. Markers, with noise σ, see
:math:`y = h(x) + H \, δx` around the last estimate:

.. math:: P \leftarrow P + (1 - e^{-2 Δt / T}) (P_0 - P), \qquad
   δx = P H^T (H P H^T + σ^2 I)^{-1} (y - h(x)), \qquad P \leftarrow (I - K H) P

Without markers, P grows back to :math:`P_0`, and x stays.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Estimate:
    """Parameters, and how well they are known.

    Attributes
    ----------
    values : array, (p,)
    covariance : array, (p, p)
    prior : array, (p,)
        Standard deviations of the parameters while nothing is seen.
    """

    values: Array
    covariance: Array
    prior: Array

    @classmethod
    def of(cls, prior: Array) -> Estimate:
        """Nothing is known yet."""
        return cls(np.zeros(len(prior)), np.diag(prior**2), prior)

    def later(self, part: float) -> Estimate:
        """After a part Δt / T of the time in which parameters change."""
        share = 1 - np.exp(-2 * part)
        grown = self.covariance + share * (np.diag(self.prior**2) - self.covariance)
        return replace(self, covariance=grown)

    def seen(self, slopes: Array, left: Array, noise: float) -> Estimate:
        """With n numbers that are seen.

        Parameters
        ----------
        slopes : array, (n, p)
            H.
        left : array, (n,)
            y − h(x).
        noise : float
            σ.
        """
        shared = self.covariance @ slopes.T
        gain = np.linalg.solve(slopes @ shared + noise**2 * np.eye(len(left)), shared.T).T
        after = self.covariance - gain @ shared.T
        return replace(self, values=self.values + gain @ left, covariance=(after + after.T) / 2)
