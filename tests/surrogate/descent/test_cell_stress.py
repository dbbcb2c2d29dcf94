"""Stresses in closed form: their forces are those of the solid, by automatic differentiation."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from surrogate.descent.cell_fields import CellFields
from surrogate.descent.cell_stress import CellStress
from surrogate.mechanics.solids.taylor_hood import TaylorHoodSolid
from tests.surrogate.descent.test_carried_compliance import KINDS, body_of

TAYLOR_HOOD = "triangle, points between, mean dilation"
TWO_SOFT_PARTS = "hexahedron, mean dilation, two materials"


@pytest.mark.parametrize("kind", [*(each for each in KINDS if each != TAYLOR_HOOD), TWO_SOFT_PARTS])
def test_forces(kind: str) -> None:
    equilibrium = body_of(kind)
    assert CellStress.is_known(equilibrium.solid)
    fields, stress = CellFields(equilibrium), CellStress(equilibrium.solid)
    u = 0.02 * np.random.default_rng(3).normal(size=equilibrium.free.shape)
    expected = equilibrium.solid.internal_forces(torch.from_numpy(u[None]))[0].numpy()
    piola = stress(fields.deformation_gradient(u))
    assert piola is not None
    size = np.abs(expected).max()
    np.testing.assert_allclose(fields.forces(piola), expected, rtol=0, atol=1e-12 * size)
    assert size > 0
    flat = fields.deformation_gradient(-equilibrium.geometry.coordinates)
    assert stress(flat) is None


def test_elements_whose_forces_are_no_sum_over_points() -> None:
    solid = body_of(TAYLOR_HOOD).solid
    assert isinstance(solid, TaylorHoodSolid)
    assert not CellStress.is_known(solid)
