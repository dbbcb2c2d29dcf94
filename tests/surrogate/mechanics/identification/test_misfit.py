"""Whether what a fit leaves is noise: by its size, by its order."""

from __future__ import annotations

import numpy as np
import pytest

from surrogate.mechanics.identification.misfit import noise_probability, order_probability


def test_size() -> None:
    """χ² of 10 numbers, less 2: 26.12 has the probability 0.001 (tables); twice for two tests."""
    x, left = np.zeros((5, 2)), np.full((5, 2), 3.0 * np.sqrt(2.612))
    assert noise_probability(x, left, 2, 3.0) == pytest.approx(0.002, rel=0.01)
    assert noise_probability(x, left, 2, None) == 1.0  # five markers tell no order


def test_noise_is_called_so() -> None:
    """Of 200 kinds of noise, 1 % are below 0.01, 5 % below 0.05 (within three deviations)."""
    found = []
    for seed in range(200):
        rng = np.random.default_rng(seed)
        found.append(order_probability(rng.random((20, 2)), rng.normal(size=(20, 2))))
    assert np.mean(np.array(found) < 0.01) < 0.04
    assert 0.01 < np.mean(np.array(found) < 0.05) < 0.1
    assert 0.35 < np.mean(np.array(found) < 0.5) < 0.65


def test_order_is_no_noise() -> None:
    """A wave over the body of the size of the noise."""
    rng = np.random.default_rng(0)
    x = rng.random((30, 2))
    left = np.sin(4 * x[:, :1]) * np.array([1.0, -1.0]) + 0.5 * rng.normal(size=(30, 2))
    left -= left.mean(axis=0)
    assert noise_probability(x, left, 2, None) < 0.005
