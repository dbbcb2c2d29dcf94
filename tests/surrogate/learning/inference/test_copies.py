"""Pickles and copies of every network that comes with the package."""

from __future__ import annotations

import copy
import multiprocessing
import pickle
import warnings

import numpy as np
import pytest
from numpy.typing import NDArray

from surrogate import Surrogate, load
from surrogate.learning.runs.shelf import SHELF

Array = NDArray[np.float64]
NAMES = sorted(config.parent.name for config in SHELF.glob("*/config.yaml"))


def loads_of(model: Surrogate) -> Array:
    """A load at the tip, and one on all nodes that may be loaded."""
    geometry, size = model.geometry, 1e-4
    one, many = np.zeros((2, *geometry.coordinates.shape))
    one[geometry.tip, -1] = -size
    many[geometry.loadable] = size / geometry.loadable.sum()
    return np.where(geometry.held, 0.0, np.stack([one, many]))


def answers(model: Surrogate) -> Array:
    """What is predicted for the loads together, and for one alone."""
    forces = loads_of(model)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return np.concatenate([model.predict(forces), model.predict(forces[:1])])


def assert_same(found: Array, expected: Array) -> None:
    """To rounding: vectorised sums depend on where an array begins in memory."""
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12 * np.abs(expected).max())


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_copies_predict_the_same(name: str) -> None:
    """Of a network that has not predicted and of one that has."""
    model = load(name)
    fresh = pickle.dumps(model)
    expected = answers(model)
    assert np.abs(expected).max() > 0
    for other in (pickle.loads(fresh), pickle.loads(pickle.dumps(model)), copy.deepcopy(model)):
        assert repr(other) == repr(model)
        assert_same(answers(other), expected)


@pytest.mark.slow
def test_another_process_predicts_the_same() -> None:
    """A new process gets a reduced network and a load series, as for `multiprocessing.Pool`."""
    models = [load("beam3d_any_reduced"), load("beam2d_any")]
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        for model, found in zip(models, pool.map(answers, models), strict=True):
            assert_same(found, answers(model))
