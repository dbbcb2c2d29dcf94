"""Bounds by energy norms on a small body with made-up errors of very different sizes."""

from __future__ import annotations

import numpy as np
import pytest

from surrogate.mechanics.equilibrium import Equilibrium
from surrogate.mechanics.newton import correct
from surrogate.uncertainty.fast_certificate import FastCertificate
from tests.surrogate.mechanics.bodies import MATERIAL, box, end_load


@pytest.fixture(scope="module")
def equilibrium() -> Equilibrium:
    return Equilibrium(box("quad"), MATERIAL)


def test_energy_norm_is_that_of_the_load(equilibrium: Equilibrium) -> None:
    """r · K⁻¹ r, with u = K⁻¹ r: twice the strain energy of linear elasticity, E ≈ r · u / 2."""
    r = end_load(box("quad"), 1e-4, -2e-4)[None]
    u = equilibrium.linear_response(r)
    twice = 2 * (equilibrium.potential(u, r) + (r * u).sum())
    assert equilibrium.energy_norm(r) ** 2 == pytest.approx(twice, rel=1e-3)


def test_coverage_on_new_samples(equilibrium: Equilibrium) -> None:
    """Errors from 1e-5 to 1e-2 m; coverage is 90 % within three standard deviations."""
    rng, n = np.random.default_rng(0), 400
    force = end_load(box("quad"), 1.0, 1.0)[None] * rng.uniform(-3, 3, (n, 1, 2))
    truth = np.stack([correct(equilibrium, f, 0 * f).displacement for f in force])
    x = box("quad").coordinates[None] / 2
    size = 10 ** rng.uniform(-5, -2, (n, 1, 1))
    shape = x[..., :1] ** 2 * rng.normal(size=(n, 1, 2)) + x[..., :1] * rng.normal(size=(n, 1, 2))
    predicted = truth + size * shape
    half = n // 2
    known = force[:half], predicted[:half], truth[:half]
    fitted = FastCertificate.fit(equilibrium, *known, level=0.9)
    bounds = fitted.bounds(force[half:], predicted[half:])
    errors = np.abs(predicted - truth).mean(axis=(1, 2))[half:]
    assert abs((errors <= bounds).mean() - 0.9) < 3 * np.sqrt(2 * 0.9 * 0.1 / half)
    assert np.median(bounds / errors) < 3  # as wide as each load needs
    assert bounds.max() / bounds.min() > 100


def test_inverted_predictions_have_no_bound(equilibrium: Equilibrium) -> None:
    force = np.stack([end_load(box("quad"), 1.0, 1.0)] * 2)
    predicted = np.zeros_like(force)
    predicted[0, -1, 0] = -0.9
    bounds = FastCertificate(0.9, 1.0, equilibrium).bounds(force, predicted)
    assert bounds[0] == np.inf
    assert 0 < bounds[1] < 1


def test_too_few_samples(equilibrium: Equilibrium) -> None:
    zeros = np.zeros((5, 28, 2))
    with pytest.raises(ValueError, match="5 calibration samples, expected at least 9"):
        FastCertificate.fit(equilibrium, zeros, zeros, zeros, 0.9)
