"""Jets against derivatives by hand, and moduli at rest against linear elasticity."""

from __future__ import annotations

import math

import numpy as np
import pytest

from shared_schema.materials import (
    ArrudaBoyce,
    Gent,
    MooneyRivlin,
    NeoHookean,
    Ogden,
    StVenantKirchhoff,
    Yeoh,
    at_rest,
)
from shared_schema.materials.material import JETS, Functions, Invariants, Jet, Scalar


def test_arithmetic() -> None:
    """f = x² eʸ / (x − y) − 3 ln(x) + ⟨y − 1⟩ at (2, 1), with g = x²/(x − y) = 4."""
    x, y = Jet.variables(2.0, 1.0)
    f = x**2 * JETS.exp(y) / (x - y) - 3 * JETS.ln(x) + JETS.positive(y - 1)
    e = math.e
    # g_x = (2x (x−y) − x²)/(x−y)² = 0, g_y = x²/(x−y)² = 4,
    # g_xx = 2 y²/(x−y)³ = 2, g_xy = −2xy/(x−y)³ = −4, g_yy = 2x²/(x−y)³ = 8
    assert f.value == pytest.approx(4 * e - 3 * math.log(2))
    assert f.gradient == pytest.approx([-1.5, 8 * e + 1])
    assert f.hessian == pytest.approx(np.array([[2 * e + 0.75, -4 * e], [-4 * e, 20 * e]]))


def test_reflected_arithmetic() -> None:
    """1 − 2/x with NumPy's numbers at x = 4: 1/2, 2/x² = 1/8, −4/x³ = −1/16."""
    (x,) = Jet.variables(4.0)
    f = np.float64(1.0) - np.float64(2.0) / x
    assert (f.value, f.gradient[0], f.hessian[0, 0]) == (0.5, 0.125, -0.0625)
    assert JETS.positive(x - 5).gradient[0] == 0
    assert (x**0).hessian[0, 0] == 0


@pytest.mark.parametrize(
    ("material", "mu", "bulk"),
    [
        (NeoHookean(young_modulus=500, poisson_ratio=0.25), 200.0, 1000 / 3),
        (StVenantKirchhoff(young_modulus=500, poisson_ratio=0.25), 200.0, 1000 / 3),
        (MooneyRivlin(c10=60, c01=25, bulk_modulus=3000), 170.0, 3000.0),
        (Yeoh(c10=80, c20=-3, c30=0.4, bulk_modulus=3000), 160.0, 3000.0),
        (Gent(shear_modulus=170, limit=8, bulk_modulus=3000), 170.0, 3000.0),
        # Σ μ α / 2
        (Ogden(mu=(630, 1.2, -10), alpha=(1.3, 5, -2), bulk_modulus=9e4), 422.5, 9e4),
        # 1 + 3/20 + 99/2800 + 513/56000 + 42039/17248000, λₘ = 2
        (
            ArrudaBoyce(shear_modulus=100, limit_stretch=2, bulk_modulus=3000),
            100 * (1 + 3 / 20 + 99 / 2800 + 513 / 56000 + 42039 / 17248000),
            3000.0,
        ),
    ],
    ids=lambda value: getattr(value, "model", ""),
)
def test_moduli_at_rest(material: NeoHookean, mu: float, bulk: float) -> None:
    rest = material.at_rest()
    assert rest.shear_modulus == pytest.approx(mu, rel=1e-12)
    assert rest.bulk_modulus == pytest.approx(bulk, rel=1e-12)
    assert material.lame_lambda == pytest.approx(bulk - 2 / 3 * mu, rel=1e-12)
    isotropic = np.diag([2 * mu] * 5 + [3 * bulk])
    assert rest.stiffness == pytest.approx(isotropic, abs=1e-9 * bulk)


def test_any_energy_of_invariants() -> None:
    """μ = 2 (ψ₁ + ψ₂); λ = 4ψ₂ + ψ_J + 4ψ₁₁ + 16ψ₁₂ + 16ψ₂₂ + 4ψ₁J + 8ψ₂J + ψ_JJ."""
    gradient, hessian = [3.0, 2.0, -14.0], [[1.0, 0.5, 0.25], [0.5, 2.0, -1.0], [0.25, -1.0, 7.0]]

    def quadratic(c: Invariants, of: Functions) -> Scalar:
        x = c.i1 - 3, c.i2 - 3, c.j - 1
        linear = sum((g * each for g, each in zip(gradient, x, strict=True)), 0.0)
        return linear + sum(
            (hessian[i][k] / 2 * x[i] * x[k] for i in range(3) for k in range(3)), 0.0
        )

    rest = at_rest(quadratic, 0)
    assert rest.stress == pytest.approx(np.zeros(6), abs=1e-12)  # 2ψ₁ + 4ψ₂ + ψ_J = 0
    mu, lam = 2 * (3 + 2), 4 * 2 - 14 + 4 + 8 + 32 + 1 - 8 + 7
    assert rest.shear_modulus == pytest.approx(mu)
    assert rest.bulk_modulus == pytest.approx(lam + 2 / 3 * mu)
