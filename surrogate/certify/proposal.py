"""Load cases that a network predicts worst: those to solve next.

Many random load cases of a family are predicted, and their errors are estimated without a
factorisation (`surrogate.certify.fast_estimate`). The proposed ones differ in what is wrong: each
is that whose estimated error field is farthest, in the Euclidean norm, from those of all proposed
before and from zero. So the first is the worst of all, and a load that is predicted as wrongly as
another, and in the same way, is not proposed beside it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from surrogate.certify.fast_certificate import fast_estimate
from surrogate.data.random_loads import RandomLoads
from surrogate.inference.prediction import PASSES, Surrogate

Array = NDArray[np.float64]
AT_ONCE = 256  # load cases


@dataclass(frozen=True)
class Proposal:
    """Proposed load cases.

    Attributes
    ----------
    forces : array, (n, n_nodes, d)
        In N, in the order in which they were chosen.
    errors : array, (n,)
        Their estimated mean errors in m; infinite if a cell is inverted.
    median : float
        Median estimated mean error of all load cases that they were chosen from, in m.
    """

    forces: Array
    errors: Array
    median: float


def propose(
    surrogate: Surrogate,
    family: RandomLoads,
    count: int,
    among: int,
    seed: int = 0,
    passes: int = PASSES,
) -> Proposal:
    """Propose load cases.

    Parameters
    ----------
    surrogate : Surrogate
    family : RandomLoads
        Family that the load cases are drawn from.
    count : int
        Number of load cases.
    among : int
        Number of load cases that are drawn, `count` at least.
    seed : int
    passes : int
        Number of passes of a stochastic network.

    Raises
    ------
    InputError
        If the run does not name its material.
    """
    forces = family.draw(among, np.random.default_rng(seed))
    estimate, fields = fast_estimate(surrogate), np.empty(forces.shape, dtype=np.float32)
    errors = np.empty(among)
    for start in range(0, among, AT_ONCE):
        some = slice(start, start + AT_ONCE)
        predicted = surrogate.predict_distribution(forces[some], passes).mean
        error = estimate(forces[some], predicted)
        errors[some] = np.abs(error).mean(axis=(1, 2))
        fields[some] = np.where(np.isfinite(error), error, predicted)  # all of it may be wrong
    chosen = farthest(fields.reshape(among, -1), count)
    return Proposal(forces[chosen], errors[chosen], float(np.median(errors)))


def farthest(points: NDArray[np.float32], count: int) -> NDArray[np.int64]:
    """Choose points far from each other and from zero, greedily: (n, m) → (count,)."""
    distance = np.linalg.norm(points, axis=1)
    chosen = np.empty(count, dtype=np.int64)
    for number in range(count):
        chosen[number] = distance.argmax()
        new = np.linalg.norm(points - points[chosen[number]], axis=1)
        distance = np.minimum(distance, new)
        distance[chosen[number]] = -1.0
    return chosen
