"""Energies against formulas in closed form, by jets, with fibres, and as recorded operations."""

from __future__ import annotations

import math
import re
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from shared_schema.common.errors import InputError
from shared_schema.materials import (
    ARRAYS,
    SHIPPED,
    ArrudaBoyce,
    FibreFile,
    FibreInvariants,
    Gent,
    Guccione,
    HolzapfelGasserOgden,
    Invariants,
    MooneyRivlin,
    NeoHookean,
    Ogden,
    RecordedMaterial,
    StVenantKirchhoff,
    Yeoh,
    at_rest,
    materials_of,
    shipped_material,
)
from shared_schema.materials.isotropic import trace_of_power
from shared_schema.materials.material import JETS, Functions, Jet, Scalar
from shared_schema.materials.own_material import RecordedEnergy, recorded
from tests.shared_schema.materials.deformations import energy, rotation, stress

EXPONENTS = [1.3, 5.0, -2.0, 0.1, -0.7, 1.0, 1.95, 3.0, -3.6, 2.0, 4.0, 8.0, -4.0, -7.7, 11.0]
# Ogden 1972: Treloar's rubber, in kg/cm² there (0.0980665 MPa)
TRELOAR = Ogden(mu=(6.3, 0.012, -0.1), alpha=(1.3, 5.0, -2.0), bulk_modulus=1e5)
PAIRS = list(zip(TRELOAR.mu, TRELOAR.alpha, strict=True))
X, Y = np.array([1.0, 0, 0]), np.array([0, 1.0, 0])
HEART = Guccione(stiffness=2e3, b_f=8, b_t=2, b_fs=4, bulk_modulus=1e5, fibres=((1.0, 0.0, 0.0),))
ARTERY: dict[str, Any] = {"c10": 7e3, "k1": 1e3, "k2": 0.8, "bulk_modulus": 1e6}
RUBBER = {"bulk_modulus": 900.0}
ONE, TWO = [1.0, 0.0], [[1.0, 0.5], [1.0, -0.5]]
KEYS_OF: dict[str, dict[str, Any]] = {
    "neo_hookean": {"young_modulus": 500.0, "poisson_ratio": 0.4},
    "st_venant_kirchhoff": {"young_modulus": 500.0, "poisson_ratio": 0.4},
    "mooney_rivlin": RUBBER | {"c10": 60.0, "c01": 30.0},
    "yeoh": RUBBER | {"c10": 90.0, "c20": -2.0, "c30": 0.1},
    "gent": RUBBER | {"shear_modulus": 180.0, "limit": 20.0},
    "ogden": RUBBER | {"mu": [90.0, 20.0], "alpha": [2.0, 3.3]},
    "arruda_boyce": RUBBER | {"shear_modulus": 180.0, "limit_stretch": 3.0},
    "holzapfel_gasser_ogden": RUBBER | {"c10": 90.0, "k1": 80.0, "k2": 0.8, "fibres": TWO},
    "guccione": RUBBER | {"stiffness": 90.0, "b_f": 8.0, "b_t": 2.0, "b_fs": 4.0, "fibres": ONE},
}
ROWS = [("shift", 2, 0, -1.0), ("power", 3, 0, 2.0)]  # (J − 1)²


def test_jets() -> None:
    """f = x² eʸ / (x − y) − 3 ln(x) + ⟨y − 1⟩ at (2, 1), with g = x²/(x − y) = 4."""
    x, y = Jet.variables(2.0, 1.0)
    f = x**2 * JETS.exp(y) / (x - y) - 3 * JETS.ln(x) + JETS.positive(y - 1)
    e = math.e
    # g_x = (2x (x−y) − x²)/(x−y)² = 0, g_y = x²/(x−y)² = 4,
    # g_xx = 2 y²/(x−y)³ = 2, g_xy = −2xy/(x−y)³ = −4, g_yy = 2x²/(x−y)³ = 8
    assert f.value == pytest.approx(4 * e - 3 * math.log(2))
    assert f.gradient == pytest.approx([-1.5, 8 * e + 1])
    assert f.hessian == pytest.approx(np.array([[2 * e + 0.75, -4 * e], [-4 * e, 20 * e]]))


def test_reflected_jets() -> None:
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
def test_wrong_exponents(mu: tuple[float, ...], alpha: tuple[float, ...], said: str) -> None:
    with pytest.raises(ValueError, match=re.escape(said)):
        Ogden(mu=mu, alpha=alpha, bulk_modulus=100.0)


def artery(**keys: Any) -> HolzapfelGasserOgden:
    return HolzapfelGasserOgden(**{**ARTERY, "fibres": ((1.0, 0.0, 0.0),), **keys})


def deformation(seed: int) -> np.ndarray:
    return np.eye(3) + 0.3 * np.random.default_rng(seed).uniform(-1, 1, (3, 3))


def test_guccione_in_components() -> None:
    """Q from the components of E in the axes f, s, n."""
    for seed in range(4):
        q = rotation(seed)
        f = deformation(seed)
        e = q.T @ (f.T @ f - np.eye(3)) @ q / 2
        exponent = (
            8 * e[0, 0] ** 2
            + 2 * (e[1, 1] ** 2 + e[2, 2] ** 2 + 2 * e[1, 2] ** 2)
            + 8 * (e[0, 1] ** 2 + e[0, 2] ** 2)
        )
        expected = 1e3 * (np.exp(exponent) - 1) + 5e4 * (np.linalg.det(f) - 1) ** 2
        assert energy(HEART, f, [q[:, 0]]) == pytest.approx(expected, rel=1e-10)


def test_holzapfel_gasser_ogden_in_components() -> None:
    """Two families at ±θ to x, dispersed, one of them compressed: ⟨E⟩ drops it."""
    f = np.array([[1.2, 0.4, 0.0], [0.0, 0.8, 0.0], [0.0, 0.0, 1.05]])
    material = artery(kappa=0.1, fibres=((1.0, 0.3, 0.0), (1.0, -0.3, 0.0)))
    directions = [np.array([1, s * 0.9, 0]) / np.hypot(1, 0.9) for s in (1, -1)]
    j = np.linalg.det(f)
    c = j ** (-2 / 3) * f.T @ f
    first = np.trace(c) - 3
    strains = [0.1 * first + 0.7 * (a @ c @ a - 1) for a in directions]
    assert strains[0] > 0 > strains[1]
    matrix = 7e3 * first + 5e5 * (j - 1) ** 2
    borne = [1e3 / 1.6 * (np.exp(0.8 * strain**2) - 1) for strain in strains]
    assert energy(material, f, directions) == pytest.approx(matrix + borne[0], rel=1e-12)
    both = artery(kappa=0.1, fibres=material.fibres, compression=True)
    assert energy(both, f, directions) == pytest.approx(matrix + sum(borne), rel=1e-12)


@pytest.mark.parametrize("stretch", [0.9, 1.2])
def test_uniaxial_tension_along_the_fibres(stretch: float) -> None:
    """Incompressible, P₁ − P₃ λ₃/λ₁ in closed form: λ₃ = λ₂ = λ^(−1/2) by symmetry.

    Guccione: W(λ) with E_ff = (λ² − 1)/2 and E_ss = E_nn = (1/λ − 1)/2; P = dW/dλ. Holzapfel:
    W = c₁₀ (λ² + 2/λ − 3) + k₁/(2 k₂)(exp(k₂ ⟨λ² − 1⟩²) − 1).
    """
    f = np.diag([stretch, stretch**-0.5, stretch**-0.5])

    def uniaxial(material: Guccione | HolzapfelGasserOgden) -> float:
        p = stress(material, f, [X])
        return float(p[0, 0] - p[2, 2] * f[2, 2] / stretch)

    along, across = (stretch**2 - 1) / 2, (1 / stretch - 1) / 2
    q = 8 * along**2 + 4 * across**2
    slope = 16 * along * stretch - 4 * across / stretch**2
    assert uniaxial(HEART) == pytest.approx(1e3 * np.exp(q) * slope, rel=1e-9)
    strain = max(stretch**2 - 1, 0.0)
    expected = 7e3 * (2 * stretch - 2 / stretch**2)
    expected += 1e3 * strain * np.exp(0.8 * strain**2) * 2 * stretch
    assert uniaxial(artery()) == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("material", [HEART, artery(kappa=0.1)], ids=lambda m: m.model)
def test_symmetry(material: Guccione | HolzapfelGasserOgden) -> None:
    """A rotation of the deformed body changes nothing; one before, only with the fibres."""
    f, a, q = deformation(5), rotation(6)[:, 0], rotation(7)
    w = energy(material, f, [a])
    assert energy(material, q @ f, [a]) == pytest.approx(w, rel=1e-12)
    assert energy(material, f @ q.T, [q @ a]) == pytest.approx(w, rel=1e-12)
    assert energy(material, f, [-a]) == pytest.approx(w, rel=1e-12)
    assert energy(material, f @ q.T, [a]) != pytest.approx(w, rel=1e-3)
    about = 2 * np.outer(a, a) - np.eye(3)  # half a turn about the fibres
    assert energy(material, f @ about, [a]) == pytest.approx(w, rel=1e-12)


def test_stiffness_at_rest_of_muscle() -> None:
    """W = C/2 Q to second order: ∂²W/∂E_ff² = C b_f, ∂²W/∂E_fs² = 2 C b_fs for E_fs = E_sf."""
    h = 1e-5
    bulk = HEART.model_copy(update={"bulk_modulus": 1e-12})
    for strain, expected in (
        (np.diag([1.0, 0, 0]), 2e3 * 8),
        (np.diag([0, 1.0, 0]), 2e3 * 2),
        (np.array([[0, 1.0, 0], [1, 0, 0], [0, 0, 0]]), 2e3 * 4 * 2),
        (np.array([[0, 0, 0], [0, 0, 1.0], [0, 1, 0]]), 2e3 * 2 * 2),
    ):
        p = stress(bulk, np.eye(3) + h * strain, [X]) - stress(bulk, np.eye(3) - h * strain, [X])
        assert float((p * strain).sum() / (2 * h)) == pytest.approx(expected, rel=1e-6)
    # 2 μ is the largest of 2 C b_f/3 + … along (2, −1, −1)/√6: C (4 b_f + 2 b_t)/6, and C b_fs
    assert HEART.lame_mu == pytest.approx(2e3 * max((4 * 8 + 2 * 2) / 6, 4) / 2, rel=1e-9)
    assert HEART.lame_lambda == pytest.approx(1e5 + 2e3 * (8 + 2 * 2) / 9 - 2 / 3 * 6e3, rel=1e-9)


def test_full_dispersion_has_no_direction() -> None:
    material = artery(kappa=1 / 3)
    f = deformation(2)
    assert energy(material, f, [X]) == pytest.approx(energy(material, f, [Y]), rel=1e-12)


KEYS = {"model": "guccione", "stiffness": 1, "b_f": 1, "b_t": 1, "b_fs": 1, "bulk_modulus": 1}


@pytest.mark.parametrize(
    ("fibres", "said"),
    [
        ([0, 0, 0], "key 'fibres': the vector [0.0, 0.0, 0.0] has no direction"),
        ([1], "key 'fibres': expected a vector, one for each family, or {file: FILE.npy}"),
        ([1, "x"], "key 'fibres': expected a vector, one for each family"),
        ("along x", "key 'fibres' = 'along x': expected a vector, one for each family"),
        ([[1, 0], [0, 1]], "key 'fibres': found 2 directions, expected 1"),
        ([], "key 'fibres': expected a vector, one for each family"),
        ({"field": "f"}, "unknown key 'fibres.field', expected 'file'"),
    ],
)
def test_wrong_fibres(fibres: Any, said: str) -> None:
    with pytest.raises(ValueError, match=re.escape(said)):
        shipped_material({**KEYS, "fibres": fibres})


def test_fibres_are_of_materials_with_fibres() -> None:
    with pytest.raises(ValueError, match="key 'fibres' is missing"):
        shipped_material(KEYS)
    with pytest.raises(ValueError, match="unknown key 'fibres'"):
        shipped_material({"young_modulus": 1, "poisson_ratio": 0.3, "fibres": [1, 0]})
    material = shipped_material({**KEYS, "fibres": {"file": "directions.npy"}})
    assert isinstance(material, Guccione)
    assert isinstance(material.fibres, FibreFile)
    assert material.family_count == 1


def states(families: int) -> Invariants:
    """Invariants of 50 random states about rest."""
    rng = np.random.default_rng(0)
    values = 1 + 0.2 * rng.uniform(-1, 1, (3 + 2 * families, 50))
    values[:2] *= 3
    pairs = zip(values[3::2], values[4::2], strict=True)
    i1, i2, j = values[:3]
    return Invariants(i1, i2, j, tuple(FibreInvariants(*pair) for pair in pairs))


@pytest.mark.parametrize("name", SHIPPED)
def test_operations_of_shipped_energies(name: str) -> None:
    """Values to rounding, and stiffness at rest, of all materials."""
    material = shipped_material({"model": name, **KEYS_OF[name]})
    families = material.family_count
    record = RecordedEnergy.model_validate_json(
        recorded(material.energy, families).model_dump_json()
    )
    at = states(families)
    expected = np.asarray(material.energy(at, ARRAYS))
    found = np.asarray(record(at, ARRAYS))
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12 * np.abs(expected).max())
    np.testing.assert_allclose(
        at_rest(record, families).stiffness, material.at_rest().stiffness, rtol=1e-12, atol=1e-9
    )


def test_recorded_arithmetic() -> None:
    """What Python's operators do with numbers, NumPy's ones among them, on both sides."""

    def energy(c: Any, of: Any) -> Any:
        quotient = 2 / c.i1 - np.float64(0.5) * c.i2 / c.j + (3 - c.j) / 4
        return +quotient - (-of.ln(c.j)) * of.exp(1 - c.i1 / 3) + of.positive(c.j - 1) + of.ln(2.0)

    at, record = states(0), recorded(energy, 0)
    np.testing.assert_allclose(record(at, ARRAYS), energy(at, ARRAYS), rtol=1e-13)
    i1_alone = recorded(lambda c, of: c.i1, 0)
    assert np.array_equal(i1_alone(at, ARRAYS), at.i1)


def test_a_part_that_is_not_returned_is_not_the_energy() -> None:
    def energy(c: Any, of: Any) -> Any:
        result = c.i1 * c.j
        of.exp(result)
        return result

    at = states(0)
    np.testing.assert_array_equal(recorded(energy, 0)(at, ARRAYS), at.i1 * at.j)


@pytest.mark.parametrize(
    "rows",
    [
        [],
        [("sum", 0, 3, 0.0)],  # a slot that is filled by itself
        [("product", 5, 0, 0.0)],
        [("shift", -1, 0, 1.0)],
        [("power", 0, 0, float("inf"))],
        [("import", 0, 0, 0.0)],
    ],
)
def test_wrong_records(rows: list[Any]) -> None:
    with pytest.raises(ValidationError):
        RecordedEnergy.model_validate({"families": 0, "operations": rows})


def test_material_of_a_dataset() -> None:
    """W = μ/2 (Ī₁ − 3) + K/2 (J − 1)² by hand: μ and λ = K − 2/3 μ; no solid without the first."""
    rows = [
        *ROWS,
        ("scale", 4, 0, 450.0),
        ("power", 2, 0, -2 / 3),
        ("product", 6, 0, 0.0),
        ("shift", 7, 0, -3.0),
        ("scale", 8, 0, 90.0),
        ("sum", 9, 5, 0.0),
    ]
    content = {"model": "gel.py:Gel", "model_sha256": "0" * 64, "shear": 180.0}
    energy = {"families": 0, "operations": rows}
    material = materials_of(content | {"recorded": energy}, "case")
    assert isinstance(material, RecordedMaterial)
    assert material.lame_mu == pytest.approx(180, rel=1e-12)
    assert material.lame_lambda == pytest.approx(900 - 120, rel=1e-12)
    with pytest.raises(InputError, match="the shear modulus at rest is 0 Pa"):
        materials_of(content | {"recorded": {"families": 0, "operations": ROWS}}, "case")
    with pytest.raises(InputError, match="no record of its energy"):
        materials_of(content, "case")
