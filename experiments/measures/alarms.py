"""Alarms: how well a score tells loads unlike those of the training from the test split.

An alarm is rated by the area under its receiver operating characteristic (AUROC): the probability
that the score of an unusual load is above that of a load of the test split. 0.5 is chance. No
solutions are needed for it.

A network may be right far from its training, and an alarm is then not wanted. `alarms_of_errors`
therefore rates the same scores by true errors, of equilibria that corrections lead to.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import rankdata

from shared_schema import NeoHookean
from shared_schema.common import WorkError
from surrogate import Surrogate
from surrogate.learning.data import RandomLoads, at_free
from surrogate.mechanics import Equilibrium, norms
from surrogate.mechanics.certify import Certificate, certify, correct

Array = NDArray[np.float64]
SOFTER = 0.8  # Young's modulus of the other material, over that of the training
MORE = 3  # times as many loads
HIGHEST = 1e9  # scores that are infinite count as this
PLACE, SEVERAL, TWICE, FOUR_TIMES, MATERIAL = KINDS = (
    "untrained place",
    f"{MORE} × as many loads",
    "2 × range",
    "4 × range",
    "another material",
)


@dataclass(frozen=True)
class Judged:
    """Loads with their predictions, and the scores of alarms.

    Attributes
    ----------
    force, predicted : array, (N, n_nodes, d)
        In N and m.
    equilibrium : Equilibrium
    certificate : Certificate
    scores : dict of str to array, (N,)
        By the name of the alarm; higher ones are more unusual.
    """

    force: Array
    predicted: Array
    equilibrium: Equilibrium
    certificate: Certificate
    scores: dict[str, Array]


def judge(
    surrogate: Surrogate, force: Array, passes: int, equilibrium: Equilibrium | None = None
) -> Judged:
    """Predict some loads and judge the predictions.

    Parameters
    ----------
    surrogate : Surrogate
    force : array, (N, n_nodes, d)
        In N.
    passes : int
    equilibrium : Equilibrium, optional
        Of a body of another material.
    """
    predicted = surrogate.averaged_passes(force, passes)
    u = predicted.mean
    body = equilibrium or surrogate.body.equilibrium
    found = certify(body, force, u)
    scores = {
        "estimated error over displacement": found.relative_error,
        "estimated error": found.mean_error,
        "out-of-balance force over load": found.out_of_balance,
    }
    if equilibrium is None:
        scores["fast estimate over displacement"] = norms(surrogate.fast_estimate(force, u)) / (
            norms(u)
        )
    if surrogate.is_probabilistic:
        std = at_free(predicted.std, surrogate.geometry.free)
        scores["predicted σ"] = std.mean(axis=(1, 2))
        scores["predicted σ over displacement"] = norms(predicted.std) / norms(u)
    capped = {
        name: np.minimum(np.nan_to_num(score, nan=HIGHEST), HIGHEST)
        for name, score in scores.items()
    }
    return Judged(force, u, body, found, capped)


def judge_unusual(surrogate: Surrogate, force: Array, passes: int) -> dict[str, Judged]:
    """Judge unusual loads of every kind, as many as loads of the test split, (N, n_nodes, d)."""
    found = {
        kind: judge(surrogate, loads, passes)
        for kind, loads in unusual_loads(surrogate, force).items()
    }
    material = surrogate.description.data.material
    assert isinstance(material, NeoHookean)
    softer = material.model_copy(update={"young_modulus": SOFTER * material.young_modulus})
    body = Equilibrium(surrogate.geometry, softer)
    return found | {MATERIAL: judge(surrogate, force, passes, body)}


def unusual_loads(surrogate: Surrogate, force: Array, seed: int = 0) -> dict[str, Array]:
    """Loads outside the training of a network, by kind, as many as `force`, (N, n_nodes, d).

    Each load of 2 or 4 × range is one of `force`, scaled until its largest component is 2 or 4
    times the largest in training. Untrained places are nodes that the training never loaded. They,
    and more loads than in training, are drawn at random within the range. A kind that the body has
    no nodes for is left out.
    """
    geometry, data = surrogate.geometry, surrogate.description.data
    limit, random = np.array(data.info.force.max_abs), np.random.default_rng(seed)
    _, most = data.load_numbers
    free = np.flatnonzero(~geometry.clamped)
    trained = np.flatnonzero(geometry.loadable)
    never = np.setdiff1d(free, trained)
    kinds = {}
    if len(never) >= most:
        kinds[PLACE] = _drawn(never, most, limit, geometry.free, len(force), random)
    places = trained if len(trained) >= MORE * most else free
    if len(places) >= MORE * most:
        kinds[SEVERAL] = _drawn(places, MORE * most, limit, geometry.free, len(force), random)
    at_limit = force / (np.abs(force) / limit).max(axis=(1, 2), keepdims=True)
    return kinds | {TWICE: 2 * at_limit, FOUR_TIMES: 4 * at_limit}


def _drawn(
    nodes: NDArray[np.int64],
    count: int,
    limit: Array,
    free: NDArray[np.bool_],
    loads: int,
    random: np.random.Generator,
) -> Array:
    return RandomLoads(nodes, count, count, limit, len(free), free).draw(loads, random)


def alarms(inside: Judged, unusual: dict[str, Judged]) -> dict[str, dict[str, float]]:
    """AUROC by kind of unusual load and by alarm, of loads of the test split and unusual ones."""
    return {
        kind: {
            name: auroc(inside.scores[name], score)
            for name, score in one.scores.items()
            if kind != MATERIAL or "σ" not in name  # a network knows of no other material
        }
        for kind, one in unusual.items()
    }


@dataclass(frozen=True)
class WrongPredictions:
    """Predictions of one kind with a larger error than any of the test split.

    Attributes
    ----------
    wrong, loads : int
        Number of such predictions, and of all.
    auroc : dict of str to float
        By the name of the alarm, among these loads and those of the test split; empty if no
        prediction is wrong.
    """

    wrong: int
    loads: int
    auroc: dict[str, float]


def alarms_of_errors(inside: Judged, unusual: dict[str, Judged]) -> dict[str, WrongPredictions]:
    """Rate alarms by true errors: loads of the test split, and unusual ones by kind."""
    usual = true_errors(inside)
    found = {}
    for kind, one in unusual.items():
        error, tolerance = true_errors(one), usual.max()
        areas = {
            name: auroc_of_errors(
                np.concatenate([usual, error]),
                np.concatenate([inside.scores[name], score]),
                tolerance,
            )
            for name, score in one.scores.items()
        }
        known = {name: area for name, area in areas.items() if area is not None}
        found[kind] = WrongPredictions(int((error > tolerance).sum()), len(error), known)
    return found


def true_errors(judged: Judged) -> Array:
    """Mean absolute error of every prediction in m; infinite where no equilibrium is found."""
    errors = np.full(len(judged.force), np.inf)
    for sample, (force, predicted) in enumerate(zip(judged.force, judged.predicted, strict=True)):
        with suppress(WorkError):
            found = correct(judged.equilibrium, force, predicted)
            errors[sample] = np.abs(predicted - found.displacement).mean()
    return errors


def auroc(inside: Array, outside: Array) -> float:
    """Probability that a score outside is above one inside; ties count half."""
    ranks = rankdata(np.concatenate([inside, outside]))[len(inside) :]
    count = len(outside)
    return float((ranks.sum() - count * (count + 1) / 2) / (count * len(inside)))


def auroc_of_errors(error: Array, score: Array, tolerance: float) -> float | None:
    """AUROC of a score as an alarm for errors above a tolerance in m; None if all are alike."""
    wrong = error > tolerance
    return None if wrong.all() or not wrong.any() else auroc(score[~wrong], score[wrong])
