"""Every shipped network answers alike in any unit: length, stiffness, load times 1e-6 … 1e6."""

from __future__ import annotations

import logging
from collections.abc import Iterator

import numpy as np
import pytest

from tests.surrogate.scaled import scaled

LARGE = [pytest.mark.slow]
NAMES = [
    "beam2d_any",
    "lshape2d_any",
    pytest.param("finger3d", marks=LARGE),
    pytest.param("beam3d_any", marks=LARGE),
    pytest.param("beam3d_any_reduced", marks=LARGE),
]
FACTORS = [(1e-6, 1.0), (1e6, 1.0), (1.0, 1e-6), (1.0, 1e6), (1e-6, 1e-6), (1e6, 1e6)]
SINGLE = 3e-5  # of the largest displacement: single precision, which a series amplifies
ESTIMATED = 5e-4  # likewise: K(0)⁻¹ of large bodies in single precision


@pytest.fixture(scope="module", params=NAMES)
def name(request: pytest.FixtureRequest) -> Iterator[str]:
    """A network, for all loads."""
    yield request.param
    scaled.cache_clear()  # large bodies keep their factors


@pytest.mark.filterwarnings(
    "ignore::surrogate.learning.inference.training_range.OutsideTrainingWarning"
)
@pytest.mark.parametrize("load", [1.0, 1e-6])
def test_lengths_stiffnesses_and_loads_of_any_size(
    name: str, load: float, caplog: pytest.LogCaptureFixture
) -> None:
    """Displacements, estimates and corrections over the length, stresses over the stiffness."""
    caplog.set_level(logging.ERROR)
    model, _ = scaled(name)
    geometry, rng = model.geometry, np.random.default_rng(0)
    movable = np.flatnonzero(geometry.loadable & ~geometry.held.any(axis=1))
    force = np.zeros((2, *geometry.coordinates.shape))
    largest = load * np.array(model.description.data.info.force.max_abs)
    for one in force:
        one[rng.choice(movable, 2, replace=False)] = rng.uniform(-0.6, 0.6, 2)[:, None] * largest
    dead = geometry.pressed is None and name != "beam3d_any_reduced"  # the body of beam3d_any
    predicted, alone = model.predict(force), model.predict(force[0])
    size = np.abs(predicted).max()
    linear = model.body.equilibrium.linear_response(force)
    if dead:
        certificate, fast = model.certify(force, predicted), model.fast_estimate(force, predicted)
        correction = model.correct(force[0], predicted[0])
        truth, stress = correction.displacement, model.stresses(predicted[0])["von_mises"]
    for length, modulus in FACTORS if len(force[0]) < 100 else FACTORS[::3]:
        other, unit = scaled(name, length, modulus)
        many, one = other.predict(unit * force), other.predict(unit * force[0])
        assert many / length == pytest.approx(predicted, abs=SINGLE * size)
        assert one / length == pytest.approx(alone, abs=SINGLE * size)
        found = other.body.equilibrium.linear_response(unit * force)
        assert found / length == pytest.approx(linear, abs=1e-8 * size)
        if not dead:
            continue
        given = unit * force, length * predicted
        scaled_certificate = other.certify(*given)
        assert scaled_certificate.error / length == pytest.approx(
            certificate.error, abs=1e-7 * size
        )
        np.testing.assert_array_equal(scaled_certificate.settled, certificate.settled)
        estimated = other.fast_estimate(*given) / length
        assert estimated == pytest.approx(fast, abs=ESTIMATED * size)
        found_one = other.correct(given[0][0], given[1][0])
        assert found_one.displacement / length == pytest.approx(truth, abs=1e-7 * size)
        assert abs(found_one.iterations - correction.iterations) <= 1
        mises = other.stresses(given[1][0])["von_mises"] / modulus
        assert mises == pytest.approx(stress, rel=1e-6, abs=1e-9 * stress.max())
