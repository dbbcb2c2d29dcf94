r"""Bounds of the error of single predictions, without a factorisation of the tangent.

The out-of-balance forces r of a prediction have the energy norm

.. math:: η = \sqrt{r · K(0)^{-1} r}

with the stiffness of the undeformed body, whose factor is kept; it costs one evaluation of forces
and one solve. The ratio of the mean error e (the paper's e_m) to η is calibrated on held-out
samples: with their conformal quantile q (`surrogate.uncertainty.conformal`),

.. math:: P(e \le q η) \ge 1 - α

for loads like theirs. Unlike a conformal interval of fixed width, the bound is as wide as a load
needs. Where a cell is inverted, it is infinite.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from surrogate.mechanics.equilibrium import Equilibrium
from surrogate.uncertainty.conformal import conformal_quantile

Array = NDArray[np.float64]


@dataclass(frozen=True)
class FastCertificate:
    """Calibrated bounds of mean errors.

    Attributes
    ----------
    level : float
        Nominal coverage 1 − α.
    factor : float
        q in m/√J.
    equilibrium : Equilibrium
    """

    level: float
    factor: float
    equilibrium: Equilibrium

    @classmethod
    def fit(
        cls, equilibrium: Equilibrium, force: Array, predicted: Array, truth: Array, level: float
    ) -> FastCertificate:
        """Calibrate on samples that were not trained on, (n, n_nodes, d) in N, m and m.

        Raises
        ------
        ValueError
            If the level is not between 0 and 1, or there are too few samples for it.
        """
        errors = np.abs(predicted - truth).mean(axis=(1, 2))
        norms = _energy_norms(equilibrium, force, predicted)
        ratios = np.divide(errors, norms, out=np.zeros_like(errors), where=errors > 0)
        return cls(level, float(conformal_quantile(ratios, level)), equilibrium)

    def bounds(self, force: Array, predicted: Array) -> Array:
        """Bounds of the mean absolute error of a component in m: (N, n_nodes, d) twice → (N,)."""
        return self.factor * _energy_norms(self.equilibrium, force, predicted)


def _energy_norms(equilibrium: Equilibrium, force: Array, predicted: Array) -> Array:
    held = np.where(equilibrium.free, predicted, 0.0)
    norms = np.full(len(held), np.inf)
    sound = equilibrium.inverted(held) == 0
    norms[sound] = equilibrium.energy_norm(equilibrium.out_of_balance(held[sound], force[sound]))
    return norms
