"""Corrections of every kind of wrong prediction end at one equilibrium."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from shared_schema.common.errors import WorkError
from surrogate.mechanics.certify.correction import correct, safest_start
from surrogate.mechanics.equilibrium.out_of_balance import Equilibrium
from tests.surrogate.mechanics.bodies import MATERIAL, box, end_load

FORCES = {
    "quad": (3.0, -9.0),
    "triangle": (3.0, -9.0),
    "hexahedron": (3.0, -9.0, 5.0),
    "tetra": (3.0, -9.0, 5.0),
}


@pytest.mark.parametrize("cell_type", FORCES)
def test_any_prediction_leads_to_the_equilibrium(cell_type: str) -> None:
    """Forces balance to 1e-8 N; displacements, up to 0.7 m, agree to 1e-8 m."""
    geometry = box(cell_type)
    equilibrium = Equilibrium(geometry, MATERIAL)
    force = end_load(geometry, *FORCES[cell_type])
    rng = np.random.default_rng(0)
    x = geometry.coordinates
    expected = correct(equilibrium, force, np.zeros_like(x))
    truth = expected.displacement
    assert 0.1 < np.abs(truth).max() < 1.0
    assert not truth[geometry.clamped].any()
    assert expected.residual_norm <= 1e-8
    wrong = {
        "exact": truth,
        "near": truth + 0.01 * x[:, :1] * rng.normal(size=x.shape[1]),
        "random": rng.normal(size=x.shape),
        "small and random": 0.02 * rng.normal(size=x.shape),
        "mirrored": x * [-2, *[0] * (x.shape[1] - 1)],
        "of another load": -truth,
        "far away": truth * 1e200,
        "no numbers": np.full_like(x, np.nan),
        "infinite": np.full_like(x, np.inf),
    }
    found = {name: correct(equilibrium, force, field) for name, field in wrong.items()}
    for name, correction in found.items():
        assert correction.residual_norm <= 1e-8, name
        np.testing.assert_allclose(correction.displacement, truth, atol=1e-8, err_msg=name)
    assert (found["exact"].iterations, found["exact"].start) == (0, "prediction")
    assert found["near"].iterations < expected.iterations
    for name in ("random", "mirrored", "of another load", "far away", "no numbers", "infinite"):
        assert found[name].start != "prediction", name
        assert found[name].iterations <= expected.iterations, name


def test_start_of_lowest_energy() -> None:
    """A small load: K⁻¹f has the lowest energy, -f·K⁻¹f / 2, up to terms of third order."""
    geometry = box("quad")
    equilibrium = Equilibrium(geometry, MATERIAL)
    force = end_load(geometry, 3e-3, 6e-3)[None]
    linear = equilibrium.linear_response(force)
    assert equilibrium.potential(linear, force) == pytest.approx(
        -0.5 * (force * linear).sum(), rel=3e-3
    )
    for predicted, name in (
        (1.1 * linear, "linear response"),
        (-linear, "linear response"),
        (correct(equilibrium, force[0], linear[0]).displacement[None], "prediction"),
    ):
        start, u = safest_start(equilibrium, force, predicted)
        assert start == name
        np.testing.assert_array_equal(u, predicted if name == "prediction" else linear)


def test_no_load() -> None:
    geometry = box("hexahedron")
    equilibrium = Equilibrium(geometry, MATERIAL)
    found = correct(equilibrium, end_load(geometry, 0, 0, 0), geometry.coordinates)
    assert not found.displacement.any()
    assert found.iterations == 0


def test_failure_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("surrogate.mechanics.certify.correction.ITERATIONS", 1)
    geometry = box("quad")
    force = end_load(geometry, 3.0, -9.0)
    with pytest.raises(WorkError, match="no equilibrium after 1 Newton iterations, residual"):
        correct(Equilibrium(geometry, MATERIAL), force, 0 * force)


@pytest.mark.parametrize("cell_type", FORCES)
def test_a_few_inverted_cells(cell_type: str) -> None:
    """One inner node of the exact field is moved by two edges: the start is another one."""
    geometry = box(cell_type)
    equilibrium = Equilibrium(geometry, MATERIAL)
    force, x = end_load(geometry, *FORCES[cell_type]), geometry.coordinates
    expected = correct(equilibrium, force, np.zeros_like(x))
    wrong, tip = expected.displacement.copy(), geometry.tip
    wrong[tip, 0] -= 2 * np.ptp(x[geometry.cells], axis=1).max()
    assert equilibrium.inverted(wrong[None]) > 0
    found = correct(equilibrium, force, wrong)
    assert found.start != "prediction"
    assert found.iterations == expected.iterations  # from rest as well
    np.testing.assert_allclose(found.displacement, expected.displacement, atol=1e-8)


def test_a_soft_part_on_a_stiff_one_moves_far() -> None:
    """Stiffness 10⁸ : 1, the load of the soft half: as without the stiff half's rounding errors.

    The stiff half is rigid beside the soft one, so 10⁸ and 10⁷ times its stiffness agree to some
    millionths.
    """
    geometry = box("quad")
    middle = geometry.coordinates[geometry.cells].mean(axis=1)[:, 0]
    soft = middle > geometry.coordinates[:, 0].max() / 2
    body = replace(geometry, parts=soft.astype(np.int64))
    force = 1e-8 * end_load(geometry, 3.0, -9.0)
    found = []
    for ratio in (1e-8, 1e-7):
        materials = (
            MATERIAL,
            MATERIAL.model_copy(update={"young_modulus": MATERIAL.young_modulus * ratio}),
        )
        equilibrium = Equilibrium(body, materials)
        correction = correct(equilibrium, force * ratio / 1e-8, np.zeros_like(force))
        assert correction.residual_norm < 1e-3 * np.linalg.norm(force)
        found.append(correction.displacement)
    assert np.abs(found[0]).max() > 0.05
    np.testing.assert_allclose(found[0], found[1], atol=1e-4 * np.abs(found[0]).max())
