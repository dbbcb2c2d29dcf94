"""Ogden's energy without eigenvalues, against principal stretches."""

from __future__ import annotations

import re

import numpy as np
import pytest

from shared_schema.materials import Ogden
from shared_schema.materials.isotropic import trace_of_power
from tests.shared_schema.materials.deformations import energy, rotation, stress

EXPONENTS = [1.3, 5.0, -2.0, 0.1, -0.7, 1.0, 1.95, 3.0, -3.6, 2.0, 4.0, 8.0, -4.0, -7.7, 11.0]
# Ogden 1972: Treloar's rubber, in kg/cm² there (0.0980665 MPa)
TRELOAR = Ogden(mu=(6.3, 0.012, -0.1), alpha=(1.3, 5.0, -2.0), bulk_modulus=1e5)
PAIRS = list(zip(TRELOAR.mu, TRELOAR.alpha, strict=True))


@pytest.mark.parametrize("alpha", EXPONENTS)
def test_powers_of_stretches(alpha: float) -> None:
    """Stretches between 1/4 and 4, two or three of them equal, and any others."""
    random = np.random.default_rng(0)
    logarithms = random.uniform(-1, 1, (200, 3))
    logarithms[:20, 1] = logarithms[:20, 0]
    logarithms[20] = 0.0
    logarithms -= logarithms.mean(axis=1, keepdims=True)
    logarithms *= np.minimum(1, np.log(4) / np.abs(logarithms).max(axis=1, initial=1e-9))[:, None]
    stretches = np.vstack([np.exp(logarithms), [4, 0.5, 0.5], [0.25, 2, 2]])
    squares = stretches**2
    found = trace_of_power(squares.sum(axis=1), (1 / squares).sum(axis=1), alpha / 2)
    np.testing.assert_allclose(found, (stretches**alpha).sum(axis=1), rtol=2e-12)


@pytest.mark.parametrize("stretch", [0.5, 1.01, 2.0, 4.0])
def test_treloars_rubber_under_tension(stretch: float) -> None:
    """Incompressible: P = Σ μ (λ^(α−1) − λ^(−α/2−1)), with λ₂ = λ₃ = λ^(−1/2)."""
    assert _tension(stretch, stretch**-0.5) == pytest.approx(
        sum(m * (stretch ** (a - 1) - stretch ** (-a / 2 - 1)) for m, a in PAIRS), rel=1e-9
    )


@pytest.mark.parametrize("stretch", [0.5, 1.01, 2.0])
def test_treloars_rubber_under_equal_tension(stretch: float) -> None:
    """Equibiaxial, incompressible: P = Σ μ (λ^(α−1) − λ^(−2α−1)), with λ₂ = λ and λ₃ = λ^(−2)."""
    assert _tension(stretch, stretch) == pytest.approx(
        sum(m * (stretch ** (a - 1) - stretch ** (-2 * a - 1)) for m, a in PAIRS), rel=1e-9
    )


def _tension(first: float, second: float) -> float:
    """P₁ of stretches of product 1, with the pressure that makes P₃ vanish."""
    third = 1 / (first * second)
    p = stress(TRELOAR, np.diag([first, second, third]))
    return float(p[0, 0] - p[2, 2] * third / first)


def test_energy_of_any_deformation() -> None:
    """Against the eigenvalues of C: Σ μ/α (λ̄₁^α + λ̄₂^α + λ̄₃^α − 3) + K/2 (J − 1)²."""
    f = rotation(1) @ np.diag([1.6, 1.6, 0.5]) @ rotation(2)
    j, values = np.linalg.det(f), np.sqrt(np.linalg.eigvalsh(f.T @ f))
    values *= j ** (-1 / 3)
    expected = sum(m / a * ((values**a).sum() - 3) for m, a in PAIRS)
    assert energy(TRELOAR, f) == pytest.approx(expected + 5e4 * (j - 1) ** 2, rel=1e-11)


@pytest.mark.parametrize(
    ("mu", "alpha", "said"),
    [
        ((1.0, 2.0), (2.0,), "'alpha' = [2.0]: expected as many numbers as 'mu' has, 2"),
        ((1.0,), (0.0,), "'alpha' = [0.0]: expected none of them 0"),
        ((-1.0,), (2.0,), "the shear modulus at rest is -1 Pa, expected above 0"),
        ((1.0,), (21.0,), "less than or equal to 20"),
    ],
)
def test_wrong_keys(mu: tuple[float, ...], alpha: tuple[float, ...], said: str) -> None:
    with pytest.raises(ValueError, match=re.escape(said)):
        Ogden(mu=mu, alpha=alpha, bulk_modulus=100.0)
