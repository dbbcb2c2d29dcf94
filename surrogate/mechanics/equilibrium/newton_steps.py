r"""Newton steps, with the simplified steps that tell whether they contract.

A second step with the same factorisation, the simplified Newton step
:math:`\bar δ = -K(u)^{-1} r(u + δ)`, tells what δ leaves:
:math:`Θ = ‖\bar δ‖_2 / ‖δ‖_2` is the contraction of Newton's method (Deuflhard, *Newton Methods for
Nonlinear Problems*, 2004, Section 2.1). Near an equilibrium Θ is small. A third step with this
factorisation tells whether it remains small: where cells at u are far more distorted, and stiffer,
than those at the equilibrium, the steps become small before they arrive.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
CONTRACTION = 0.25  # largest Θ of steps that settle
SMALL_PART = 1e-3  # of an error: largest third step that need not contract


@dataclass(frozen=True)
class NewtonSteps:
    """Newton steps of N displacement fields.

    Attributes
    ----------
    steps : array, (N, n_nodes, d)
        δ in m; zero at clamped nodes.
    simplified : array, (N, n_nodes, d)
        Simplified steps from u + δ in m; not finite if a cell is inverted there.
    further : array, (N, n_nodes, d)
        Simplified steps from u + δ + δ̄ in m; not finite if a cell is inverted on the way.
    stable : array of bool, (N,)
        True where K(u), or its symmetric part, is positive definite.
    """

    steps: Array
    simplified: Array
    further: Array
    stable: NDArray[np.bool_]

    def contract(self, error: Array) -> NDArray[np.bool_]:
        """Whether the steps settle, (N,): δ̄ is at most a quarter of δ, and contracts as well.

        It need not where the third step is at most a thousandth of the norm of an estimated error
        in m, (N,).
        """
        first, second, third = (norms(f) for f in (self.steps, self.simplified, self.further))
        further = (third <= CONTRACTION * second) | (third <= SMALL_PART * error)
        return np.asarray((second <= CONTRACTION * first) & further)


def norms(fields: Array) -> Array:
    """Euclidean norm of every field: (N, n_nodes, d) → (N,)."""
    return np.sqrt(np.square(fields).sum(axis=(1, 2)))
