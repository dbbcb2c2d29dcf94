"""Certificates of made-up networks: alarms by hand, and kinds of loads."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from experiments.measures.alarms import (
    FOUR_TIMES,
    PLACE,
    SEVERAL,
    TWICE,
    Judged,
    WrongPredictions,
    alarms_of_errors,
    auroc,
    auroc_of_errors,
    true_errors,
    unusual_loads,
)
from experiments.measures.corrections import (
    LINEAR,
    PREDICTION,
    ZERO,
    newton_starts,
)
from surrogate.learning.inference.loading import load
from surrogate.mechanics.certify.correction import correct
from surrogate.mechanics.certify.full_certificate import certify
from surrogate.mechanics.equilibrium.out_of_balance import Equilibrium
from tests.surrogate.mechanics.bodies import MATERIAL as RUBBER
from tests.surrogate.mechanics.bodies import box, end_load


def test_auroc_by_hand() -> None:
    """Of the 6 pairs, 4 are in order and one is a tie: 4.5 / 6."""
    assert auroc(np.array([1.0, 3.0]), np.array([2.0, 3.0, 4.0])) == pytest.approx(4.5 / 6)
    error, score = np.array([0.1, 0.2, 3.0]), np.array([5.0, 1.0, 4.0])
    assert auroc_of_errors(error, score, 1.0) == 0.5
    assert auroc_of_errors(error, score, 9.0) is None


def test_unusual_loads(trained: Path) -> None:
    """The training loads one node of the upper edge, within ±2.5 N."""
    surrogate = load(trained)
    info, geometry = surrogate.description.data.info, surrogate.geometry
    limit = np.array(info.force.max_abs)
    force = np.zeros((40, *geometry.coordinates.shape))
    node = np.flatnonzero(geometry.loadable)[0]
    force[:, node] = np.random.default_rng(0).uniform(-1, 1, (40, geometry.dimension))
    found = unusual_loads(surrogate, force)
    for kind, factor in ((TWICE, 2), (FOUR_TIMES, 4)):
        reach = (np.abs(found[kind]) / limit).max(axis=(1, 2))
        assert reach == pytest.approx(factor)
    elsewhere = np.any(found[PLACE], axis=2)
    assert (elsewhere.sum(axis=1) == 1).all()
    assert not elsewhere[:, geometry.loadable | geometry.clamped].any()
    assert (found[SEVERAL].any(axis=2).sum(axis=1) == 3).all()
    assert (np.abs(found[SEVERAL]) <= limit).all()


def test_alarms_of_errors() -> None:
    """One of two unusual predictions is wrong: only one score is higher for it than for others."""
    equilibrium = Equilibrium(box("quad"), RUBBER)
    force = end_load(box("quad"), 1.0, -4.0)[None] * np.array([1.0, 0.5])[:, None, None]
    exact = np.stack([correct(equilibrium, f, 0 * f).displacement for f in force])

    def judged(scale: tuple[float, float], **scores: list[float]) -> Judged:
        predicted = exact * np.array(scale)[:, None, None]
        certificate = certify(equilibrium, force, predicted)
        arrays = {name: np.array(values) for name, values in scores.items()}
        return Judged(force, predicted, equilibrium, certificate, arrays)

    inside = judged((1.01, 0.99), right=[0.0, 1.0], wrong=[3.0, 4.0])
    unusual = judged((1.5, 1.001), right=[2.0, 0.0], wrong=[2.0, 5.0])
    assert true_errors(inside) == pytest.approx(0.01 * np.abs(exact).mean(axis=(1, 2)))
    found = alarms_of_errors(inside, {"kind": unusual, "same": inside})
    assert found["kind"] == WrongPredictions(1, 2, {"right": 1.0, "wrong": 0.0})
    assert found["same"] == WrongPredictions(0, 2, {})


def test_starts_of_newtons_method() -> None:
    """A start in equilibrium needs no iteration; all starts lead to one."""
    equilibrium = Equilibrium(box("quad"), RUBBER)
    force = end_load(box("quad"), 1.0, -4.0)[None] * np.array([1.0, 0.5])[:, None, None]
    wrong = np.full_like(force, np.nan)
    from_nothing = newton_starts(equilibrium, force, wrong)
    assert [effort.lost for effort in from_nothing.values()] == [0, 0, 0]
    assert from_nothing[ZERO].iterations.min() >= 3
    truth = equilibrium.linear_response(force)
    for row in range(2):
        truth[row] = correct(equilibrium, force[row], wrong[row]).displacement
    found = newton_starts(equilibrium, force, truth)
    assert found[PREDICTION].iterations.tolist() == [0.0, 0.0]
    assert found[LINEAR].iterations.tolist() == from_nothing[LINEAR].iterations.tolist()
