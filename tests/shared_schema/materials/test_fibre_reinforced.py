"""Materials with fibres, against their formulas in components; their symmetry and their keys."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pytest

from shared_schema.materials import FibreFile, Guccione, HolzapfelGasserOgden, shipped_material
from tests.shared_schema.materials.deformations import energy, rotation, stress

X, Y = np.array([1.0, 0, 0]), np.array([0, 1.0, 0])
HEART = Guccione(stiffness=2e3, b_f=8, b_t=2, b_fs=4, bulk_modulus=1e5, fibres=((1.0, 0.0, 0.0),))
ARTERY: dict[str, Any] = {"c10": 7e3, "k1": 1e3, "k2": 0.8, "bulk_modulus": 1e6}


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
