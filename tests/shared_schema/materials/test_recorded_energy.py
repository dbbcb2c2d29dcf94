"""Energies as lists of operations: repeated, they give the numbers of the code they are from."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from shared_schema.common.errors import InputError
from shared_schema.materials import (
    ARRAYS,
    SHIPPED,
    FibreInvariants,
    Invariants,
    RecordedMaterial,
    at_rest,
    materials_of,
    shipped_material,
)
from shared_schema.materials.own_material import RecordedEnergy, recorded

RUBBER = {"bulk_modulus": 900.0}
ONE, TWO = [1.0, 0.0], [[1.0, 0.5], [1.0, -0.5]]
KEYS: dict[str, dict[str, Any]] = {
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
    material = shipped_material({"model": name, **KEYS[name]})
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


def test_arithmetic() -> None:
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
