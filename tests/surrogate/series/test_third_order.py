"""The load series: its remainder is of fourth order in the load."""

from __future__ import annotations

import numpy as np
import pytest

from shared_schema.materials import MooneyRivlin, StVenantKirchhoff
from surrogate.certify.correction import correct
from surrogate.mechanics.out_of_balance import Equilibrium
from surrogate.series.third_order import third_order_terms
from tests.surrogate.mechanics.bodies import MATERIAL, box, end_load

FORCES = {
    "quad": (1.0, -4.0),
    "triangle": (1.0, -4.0),
    "hexahedron": (1.0, -4.0, 2.0),
    "tetra": (1.0, -4.0, 2.0),
}


@pytest.mark.parametrize("cell_type", FORCES)
def test_remainder_is_of_fourth_order(cell_type: str) -> None:
    """Equilibria at t and t / 2, by Newton's method: the remainders differ by about 2⁴."""
    geometry = box(cell_type)
    equilibrium = Equilibrium(geometry, MATERIAL)
    force = end_load(geometry, *FORCES[cell_type])
    series = third_order_terms(equilibrium, force[None])
    first, second, third = (term[0] for term in (series.first, series.second, series.third))

    def remainder(t: float) -> float:
        start = t * first + t**2 * second
        u = correct(equilibrium, t * force, start, 1e-12).displacement
        return float(np.linalg.norm(u - (start + t**3 * third)))

    assert 11 < remainder(0.5) / remainder(0.25) < 23
    assert 11 < remainder(-0.5) / remainder(-0.25) < 23
    assert remainder(0.25) < 0.05 * np.linalg.norm(0.25**3 * third)


@pytest.mark.parametrize(
    "material",
    [
        StVenantKirchhoff(young_modulus=500, poisson_ratio=0.3),
        MooneyRivlin(c10=60, c01=20, bulk_modulus=400),
    ],
)
def test_of_any_material(material: StVenantKirchhoff | MooneyRivlin) -> None:
    geometry = box("quad")
    equilibrium = Equilibrium(geometry, material)
    force = end_load(geometry, 0.1, -0.4)
    series = third_order_terms(equilibrium, force[None])
    u = correct(equilibrium, force, series.first[0], 1e-13).displacement
    without = np.linalg.norm(u - series.first[0])
    with_all = np.linalg.norm(u - series.first[0] - series.second[0] - series.third[0])
    assert with_all < 1e-3 * without


def test_loads_do_not_disturb_each_other() -> None:
    """A batch is what its loads are one by one; no load has no displacement."""
    geometry = box("quad")
    equilibrium = Equilibrium(geometry, MATERIAL)
    loads = np.stack([end_load(geometry, 1.0, -4.0), end_load(geometry, 0, 0)])
    loads = np.concatenate([loads, 1e-9 * loads[:1]])
    both = third_order_terms(equilibrium, loads)
    one = third_order_terms(equilibrium, loads[:1])
    np.testing.assert_allclose(both.third[0], one.third[0], rtol=0, atol=1e-12)
    assert not both.first[1].any()
    assert not both.second[1].any()
    assert not both.third[1].any()
    scaled = np.abs(both.second[2] - 1e-18 * both.second[0]).max()
    assert scaled < 1e-6 * 1e-18 * np.abs(both.second[0]).max()
