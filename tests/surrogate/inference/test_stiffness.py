"""Another Young's modulus: the finite elements of that body, and what scales with it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import surrogate
from shared_schema.common.errors import InputError
from shared_schema.material import NeoHookean
from shared_schema.tools import Sphere
from surrogate.certify import correct
from surrogate.command_line import main
from surrogate.mechanics.out_of_balance import Equilibrium

LOAD, YOUNG = "4,1:0.5,-3", 1200.0  # Pa; the run has 500


@pytest.fixture(scope="module")
def beam() -> surrogate.Surrogate:
    return surrogate.load("beam2d_any")


def test_equilibrium_of_the_stiffer_body(beam: surrogate.Surrogate) -> None:
    solution = beam.solve(LOAD, body_force=(0, -0.1), young_modulus=YOUNG, stresses=True)
    material = beam.description.data.material
    assert isinstance(material, NeoHookean)
    stiffer = material.model_copy(update={"young_modulus": YOUNG})
    body = Equilibrium(beam.geometry, stiffer)
    assert solution.force.sum(axis=0) == pytest.approx((0.5, -3 - 0.4), abs=0.05)
    truth = correct(body, solution.force, solution.displacement, 1e-10).displacement
    np.testing.assert_allclose(solution.displacement, truth, atol=1e-6)
    assert solution.reaction is not None
    total = solution.reaction.sum(axis=0) + solution.force.sum(axis=0)
    assert np.abs(total).max() < 1e-4
    same = beam.solve(solution.force / 2.4, stresses=True)
    np.testing.assert_allclose(solution.displacement, same.displacement, atol=1e-12)
    for name, values in solution.stresses.items():
        factor = 1.0 if name in {"deformation_gradient", "jacobian"} else 2.4
        np.testing.assert_allclose(values, factor * same.stresses[name], rtol=1e-9, atol=1e-9)


def test_forces_of_grips_and_tools(beam: surrogate.Surrogate) -> None:
    """What is given as displacement takes forces as E."""
    for given in ({"held": {"4,1": (0, -0.4)}}, {"tool": Sphere((3, 1.2), 0.3)}):
        soft, stiff = beam.solve(**given), beam.solve(**given, young_modulus=YOUNG, correct=True)
        assert np.abs(stiff.displacement - soft.displacement).max() < 1e-4
        for name in ("grips", "contact"):
            if (one := getattr(soft, name)) is not None:
                other = getattr(stiff, name)
                one, other = getattr(one, "force", one), getattr(other, "force", other)
                np.testing.assert_allclose(other, 2.4 * one, atol=1e-3 * np.abs(other).max())


def test_refusals(beam: surrogate.Surrogate, tmp_path: Path) -> None:
    for wrong in (0.0, -1.0, float("nan"), float("inf")):
        with pytest.raises(InputError, match="expected more than 0 Pa, and finite"):
            beam.solve(LOAD, young_modulus=wrong)
    path = str(tmp_path / "out.npz")
    words = ["predict", "beam2d_any", "--load", LOAD, "--out", path]
    with pytest.raises(SystemExit, match="2"):
        main([*words, "--young-modulus", "-3"])
    assert main([*words, "--young-modulus", "1200"]) == 0
