"""Tapes of energies that a dataset holds, and of powers."""

from __future__ import annotations

import numpy as np
import pytest
import sympy  # type: ignore[import-untyped]

from shared_schema.materials import SHIPPED, RecordedMaterial, shipped_material
from shared_schema.materials.own_material import recorded
from surrogate.mechanics.energy.law import law_of
from surrogate.mechanics.energy.tape import Tape
from tests.shared_schema.test_materials import KEYS_OF as KEYS


@pytest.mark.parametrize("exponent", [1, 7, 9, 17, 1000, -3, -1000, 2.5, -1000.25, 1e12])
def test_powers(exponent: float) -> None:
    """Those of 1 + 1/n and of 1 are the numbers of Python, to rounding times the exponent."""
    x = sympy.Symbol("x", positive=True)
    number = int(exponent) if float(exponent).is_integer() else exponent
    tape = Tape.of([x**number], [x])
    assert len(tape.codes) <= 85  # two for each of 40 bits
    base = 1 + 1 / abs(exponent)
    for value in (1.0, base):
        error = 4e-16 * max(1, abs(exponent)) if value != 1 else 0
        assert tape([value])[0] == pytest.approx(value**exponent, rel=max(error, 1e-15))


@pytest.mark.parametrize("name", SHIPPED)
@pytest.mark.parametrize(("dimension", "projected"), [(2, False), (3, True)])
def test_law_of_a_recorded_energy(name: str, dimension: int, projected: bool) -> None:
    """What a dataset records of a shipped energy has its derivatives, to rounding."""
    exact = {"alpha": [2.0, 4.0]} if name == "ogden" else {}  # others take seconds
    shipped = shipped_material({"model": name, **KEYS[name], **exact})
    families = shipped.family_count
    own = RecordedMaterial.model_validate(
        {
            "model": "own.py:Own",
            "model_sha256": "0" * 64,
            "recorded": recorded(shipped.energy, families),
            "fibres": KEYS[name].get("fibres"),
        }
    )
    expected, found = (law_of(each, dimension, projected) for each in (shipped, own))
    at = np.array(expected.at_rest) * np.random.default_rng(0).uniform(0.9, 1.1, expected.count)
    for of_shipped, of_own in zip(
        expected.energy(at.tolist()), found.energy(at.tolist()), strict=True
    ):
        assert of_own == pytest.approx(of_shipped, rel=1e-9, abs=1e-8)
