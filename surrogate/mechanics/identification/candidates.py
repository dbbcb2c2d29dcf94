r"""States that fit the markers, and the probability of the places of a force among them.

Many places may bear a force that fits as well as the best one. From parameters that are close to a
fit, one Gauss–Newton step is enough, and the predictions of all places are one batch. With the
noise σ of the best fit, and all nodes of the surface and radii alike beforehand, the probability of
place a is

.. math:: p_a \propto \exp\Big(-\frac12 \sum_m \min(|r_m| / σ, c)^2\Big)

with what the step leaves of the markers, :math:`r_m`; wild ones count for a constant c.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from shared_schema.common.errors import WorkError
from surrogate.mechanics.identification.least_squares import Fit, Point, stepped, wild_cost
from surrogate.mechanics.identification.responses import DIFFERENCE, differences
from surrogate.mechanics.identification.unknowns import Unknowns
from surrogate.mechanics.statics.load import Load
from surrogate.mechanics.statics.prediction import Predictor

Array = NDArray[np.float64]

SHARE = 1e-3  # probability of places that are left out of uncertainties


@dataclass(frozen=True)
class Candidate:
    """A fit of predictions.

    Attributes
    ----------
    unknowns : Unknowns
    fit : Fit
    scale : array, (p,)
    node : int or None
        Where the force acts that may act somewhere: the middle of its place.
    radius : float
        Of this place in m; 0 of a node alone.
    share : float
        Its probability among all places.
    """

    unknowns: Unknowns
    fit: Fit
    scale: Array
    node: int | None = None
    radius: float = 0.0
    share: float = 1.0


@dataclass(frozen=True)
class Start:
    """Parameters θ of a force in one place, (p,), with the sizes of changes that matter, (p,)."""

    unknowns: Unknowns
    theta: Array
    scale: Array
    node: int
    radius: float = 0.0


def joined(loads: list[Load]) -> Load:
    """Some load cases after others of the same body."""
    known = [each.pressure for each in loads if each.pressure is not None]
    dead = np.concatenate([each.dead for each in loads])
    if not known:
        return Load(dead)
    pressures = np.concatenate([each.pressures for each in known])
    return Load(dead, replace(known[0], pressures=pressures))


def likely_candidates(
    predictor: Predictor, moved: Array, at_markers: csr_array, best: Fit, starts: list[Start]
) -> list[Candidate]:
    """Take a step from every start, and return the candidates, the most likely one first.

    Parameters
    ----------
    predictor : Predictor
    moved : array, (m, d)
        Displacements of the markers in m.
    at_markers : csr_array, (m, n_nodes)
    best : Fit
        Of one of the places, whose noise and wild markers count.
    starts : list of Start
        At least one, from which predictions are finite.

    Raises
    ------
    WorkError
        If the markers do not determine the parameters of any.
    """
    points = [
        start.theta + np.vstack([0 * start.scale, np.diag(DIFFERENCE * start.scale)])
        for start in starts
    ]
    loads = [start.unknowns.load(at) for start, at in zip(starts, points, strict=True)]
    fields, _ = predictor.respond(joined(loads))
    of_starts = fields.reshape(len(starts), -1, *fields.shape[1:])
    found = []
    for start, fields in zip(starts, of_starts, strict=True):
        seen = np.array([at_markers @ field for field in fields])
        if not np.isfinite(seen).all():
            continue
        steps = DIFFERENCE * start.scale
        slopes, jacobian = (differences(of[1:], of[0], steps) for of in (fields, seen))
        point = Point(start.theta, fields[0], slopes, seen[0], jacobian)
        try:
            fit = stepped(best, moved, point, start.scale)
        except WorkError:
            continue
        found.append(Candidate(start.unknowns, fit, start.scale, start.node, start.radius))
    if not found:
        raise WorkError("the markers do not tell all that is sought")
    costs = np.array([wild_cost(one.fit.lengths, best.sigma) for one in found])
    shares = np.exp((costs.min() - costs) / 2)
    shares /= shares.sum()
    kept = [
        replace(one, share=float(share))
        for one, share in zip(found, shares, strict=True)
        if share > SHARE
    ]
    return sorted(kept, key=lambda one: -one.share)
