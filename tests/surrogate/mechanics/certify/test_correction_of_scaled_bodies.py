"""A correction ends alike on bodies of any size and stiffness, and under any load."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from shared_schema.common.bodies.equilibrium import ForceTolerance
from shared_schema.materials import NeoHookean
from surrogate.mechanics.certify.correction import correct
from surrogate.mechanics.equilibrium.out_of_balance import Equilibrium
from tests.surrogate.mechanics.bodies import MATERIAL, box, end_load

FORCE = 3.0, -9.0, 5.0


def equilibrium_of(cell_type: str, length: float, modulus: float) -> Equilibrium:
    """A box of some length in m and Young's modulus in Pa."""
    geometry = box(cell_type)
    geometry = replace(geometry, coordinates=geometry.coordinates * length / 2)
    return Equilibrium(geometry, NeoHookean(young_modulus=modulus, poisson_ratio=0.4))


@pytest.mark.parametrize("modulus", [1e-3, 500.0, 1e12])
@pytest.mark.parametrize("length", [2e-6, 40e-6, 2.0, 4e3, 2e6])
@pytest.mark.parametrize("cell_type", ["quad", "tetra"])
def test_the_same_body_of_any_size_and_stiffness(
    cell_type: str, length: float, modulus: float
) -> None:
    """u / L depends on f / (E L^(d-1)) only, and so do Newton's iterations."""
    unscaled = box(cell_type)
    d = unscaled.dimension
    force = end_load(unscaled, *FORCE[:d])
    expected = correct(Equilibrium(unscaled, MATERIAL), force, 0 * force)
    factor = modulus / MATERIAL.young_modulus * (length / 2) ** (d - 1)
    scaled = equilibrium_of(cell_type, length, modulus)
    for tolerance in (ForceTolerance(), ForceTolerance(absolute=1e-8)):
        if tolerance.absolute and factor > 1:
            continue  # below what rounding leaves
        found = correct(scaled, factor * force, 0 * force, tolerance)
        assert found.iterations in (expected.iterations, expected.iterations - 1)
        assert found.residual_norm <= 1e-6 * factor * np.linalg.norm(force)
        u = found.displacement / (length / 2)
        assert u == pytest.approx(expected.displacement, abs=1e-6)
    assert np.abs(expected.displacement).max() > 0.1


@pytest.mark.parametrize("factor", [1e-20, 1e-12, 1e-9, 1e-5])
@pytest.mark.parametrize("tolerance", [ForceTolerance(), ForceTolerance(absolute=1e-8)])
def test_small_loads_move_a_body_linearly(factor: float, tolerance: ForceTolerance) -> None:
    """By K(0)⁻¹ f up to the square of f, even where rounding errors hide the load."""
    geometry = box("quad")
    equilibrium = Equilibrium(geometry, MATERIAL)
    force = factor * end_load(geometry, 3.0, -9.0)
    linear = equilibrium.linear_response(force[None])[0]
    found = correct(equilibrium, force, np.ones_like(force), tolerance)
    assert found.displacement == pytest.approx(linear, abs=1e-3 * np.abs(linear).max())
    assert found.displacement.any()
