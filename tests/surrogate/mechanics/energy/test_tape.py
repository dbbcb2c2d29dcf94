"""Tapes of energies that a dataset holds, and of powers."""

from __future__ import annotations

import numpy as np
import pytest

from shared_schema.materials import SHIPPED, RecordedMaterial, shipped_material
from shared_schema.materials.own_material import recorded
from surrogate.mechanics.energy.law import law_of
from surrogate.mechanics.energy.recording import Recording
from surrogate.mechanics.energy.tape import tape_of
from tests.shared_schema.test_materials import KEYS_OF as KEYS


@pytest.mark.parametrize("exponent", [1, 7, 9, 17, 1000, -3, -1000, 2.5, -1000.25, 1e12])
def test_powers(exponent: float) -> None:
    """Those of 1 + 1/n and of 1 are the numbers of Python, to rounding times the exponent."""
    recording = Recording(1)
    tape = tape_of(recording, [recording.inputs[0] ** exponent])
    assert len(tape.rows) <= 85  # two for each of 40 bits
    base = 1 + 1 / abs(exponent)
    for value in (1.0, base):
        error = 4e-16 * max(1, abs(exponent)) if value != 1 else 0
        assert tape([value])[0] == pytest.approx(value**exponent, rel=max(error, 1e-15))


@pytest.mark.parametrize("name", SHIPPED)
@pytest.mark.parametrize(("dimension", "projected"), [(2, False), (3, True)])
def test_law_of_a_recorded_energy(name: str, dimension: int, projected: bool) -> None:
    """What a dataset records of a shipped energy has its derivatives, to rounding."""
    shipped = shipped_material({"model": name, **KEYS[name]})
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


@pytest.mark.parametrize("name", SHIPPED)
@pytest.mark.parametrize(("dimension", "projected"), [(2, False), (3, False), (2, True), (3, True)])
def test_derivatives(name: str, dimension: int, projected: bool) -> None:
    """Those by the measures are central differences of the energy."""
    law = law_of(shipped_material({"model": name, **KEYS[name]}), dimension, projected)
    at = np.array(law.at_rest) * np.random.default_rng(0).uniform(0.95, 1.05, law.count)
    found, step = law.stress(at.tolist()), 1e-6
    for measure, derivative in enumerate(found):
        change = step * (np.arange(law.count) == measure)
        up, down = (law.energy((at + sign * change).tolist())[0] for sign in (1, -1))
        assert derivative == pytest.approx((up - down) / (2 * step), rel=1e-6, abs=1e-4)
