"""Estimates without a factorisation, against Newton's step and other formulas of the same terms."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from shared_schema.common.bodies.polar_decomposition import cofactors, rotations
from surrogate.certify import fast_estimate
from surrogate.certify.correction import correct
from surrogate.certify.fast_estimate import FastEstimate
from surrogate.certify.full_certificate import certify
from surrogate.mechanics.block_solve import BlockSolve
from surrogate.mechanics.compliance import Compliance
from surrogate.mechanics.matrices.band_matrix import BandCholesky, BandLayout
from surrogate.mechanics.out_of_balance import Equilibrium
from tests.surrogate.mechanics.bodies import MATERIAL, box, end_load
from tests.surrogate.mechanics.test_follower_pressure import KINDS, pressed
from tests.surrogate.mechanics.test_follower_pressure import body as under_pressure


def random_deformations(d: int) -> np.ndarray:
    return np.eye(d)[:, :, None] + 0.3 * np.random.default_rng(d).normal(size=(d, d, 50))


@pytest.mark.parametrize("d", [2, 3])
def test_cofactors_are_those_of_the_inverse(d: int) -> None:
    """cof F = det F · F⁻ᵀ."""
    f = random_deformations(d).transpose(2, 0, 1)
    expected = np.linalg.det(f)[:, None, None] * np.linalg.inv(f).transpose(0, 2, 1)
    found = cofactors(f.transpose(1, 2, 0)).transpose(2, 0, 1)
    np.testing.assert_allclose(found, expected, atol=1e-12)


@pytest.mark.parametrize(("d", "tolerance"), [(2, 1e-12), (3, 1e-3)])
def test_rotations_are_those_of_the_polar_decomposition(d: int, tolerance: float) -> None:
    """F = R U: R = A Bᵀ of the singular value decomposition A S Bᵀ."""
    turn = np.linalg.qr(np.random.default_rng(0).normal(size=(d, d)))[0]
    turn[:, 0] *= np.linalg.det(turn)
    f = np.einsum("ij,jkn->ikn", turn, random_deformations(d))
    f = f[:, :, np.linalg.det(f.transpose(2, 0, 1)) > 0.3]
    left, _, right = np.linalg.svd(f.transpose(2, 0, 1))
    np.testing.assert_allclose(rotations(f).transpose(2, 0, 1), left @ right, atol=tolerance)
    inverted = -np.eye(3)[:, :, None] if d == 3 else np.diag([1.0, -1.0])[:, :, None]
    np.testing.assert_array_equal(rotations(inverted), np.eye(d)[:, :, None])


@pytest.mark.parametrize("kind", KINDS)
def test_estimate_under_pressure(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Many steps end at Newton's step with the symmetric part of the tangent."""
    body = under_pressure(kind)
    pressure = pressed(body, 9.0)
    equilibrium = Equilibrium(body, MATERIAL)
    x, force = body.coordinates, end_load(body, *(1.0, -2.0, 0.5)[: body.dimension])
    truth = correct(equilibrium.under(pressure), force, 0 * x).displacement
    wrong = 1e-3 * (x[:, :1] / 2) ** 2 * np.array([0.6, -0.8, 0.3])[: body.dimension]
    predicted, fast = (truth + wrong)[None], FastEstimate(equilibrium)
    monkeypatch.setattr(fast_estimate, "STEPS", 60)
    found, _, softest = fast.with_stability(force[None], predicted, pressure)
    under = equilibrium.under(pressure)
    (band,) = under._tangents(predicted)
    assert isinstance(under.layout, BandLayout)
    for _, facets, blocks in pressure.tangents(predicted):
        under.layout.add(band, facets, blocks)  # the lower triangle of (K + Kᵀ) / 2
    factor = BandCholesky.of(band)
    assert factor is not None
    assert softest[0] > 0.05
    expected = -under._solved([factor], under.out_of_balance(predicted, force[None]))
    size = np.linalg.norm(expected)
    assert np.linalg.norm(found - expected) < 1e-6 * size
    full = certify(under, force[None], predicted).error
    assert np.linalg.norm(found - full) < 0.5 * np.linalg.norm(full)  # whose tangent is K
    as_dead = fast(force[None] + pressure.at_rest, predicted)
    assert np.linalg.norm(as_dead - full) > 5 * size  # forces at rest are others


def test_newtons_step_at_rest() -> None:
    """There K(u) = K(0) and R = I: the first step is Newton's own."""
    body = box("hexahedron")
    equilibrium = Equilibrium(body, MATERIAL)
    force = end_load(body, 1.0, -2.0, 0.5)[None]
    found = FastEstimate(equilibrium)(force, np.zeros_like(force))
    np.testing.assert_allclose(-found, equilibrium.linear_response(force), rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("cell_type", ["quad", "hexahedron"])
@pytest.mark.parametrize("large", [False, True])
def test_error_of_a_turned_body(
    cell_type: str, large: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The end moves by 0.29 m of 2 m; the compliance at rest alone misses sevenfold."""
    monkeypatch.setattr(fast_estimate, "LARGE", 0 if large else 4000)
    body = box(cell_type)
    equilibrium = Equilibrium(body, MATERIAL)
    x = body.coordinates
    end = x[:, 0] == 2
    force = np.zeros_like(x)
    force[end, 1] = -5 / end.sum()
    truth = correct(equilibrium, force, np.zeros_like(force)).displacement
    assert np.abs(truth).max() == pytest.approx(0.29, abs=0.01)
    wrong = 1e-3 * (x[:, :1] / 2) ** 2 * np.array([0.6, -0.8, 0.3])[: body.dimension]
    predicted = (truth + wrong)[None]
    found = FastEstimate(equilibrium)(force[None], predicted)[0]
    at_rest = equilibrium.linear_response(equilibrium.out_of_balance(predicted, force[None]))[0]
    assert np.abs(found - wrong).max() < 0.1 * np.abs(wrong).max()
    assert np.abs(at_rest - wrong).max() > 7 * np.abs(wrong).max()


def test_batches_and_moved_supports() -> None:
    body = box("quad")
    equilibrium = Equilibrium(body, MATERIAL)
    fast = FastEstimate(equilibrium)
    rng = np.random.default_rng(0)
    force = end_load(body, 1.0, 1.0) * rng.uniform(-3, 3, (5, 1, 2))
    u = 1e-3 * rng.normal(size=force.shape)
    together = fast(force, u)
    fast._at_once = 2
    np.testing.assert_allclose(fast(force, u), together, rtol=1e-10)
    np.testing.assert_array_equal(together[:, body.clamped], u[:, body.clamped])


@pytest.mark.parametrize("whole", [False, True])
@pytest.mark.parametrize("large", [False, True])
def test_blocks_of_a_gpu(large: bool, whole: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """With tensors, and without a factor: the same estimates as with arrays."""
    monkeypatch.setattr(fast_estimate, "LARGE", 0 if large else 4000)
    body = replace(box("hexahedron"), mean_dilation=whole)
    equilibrium, rng = Equilibrium(body, MATERIAL), np.random.default_rng(2)
    force = end_load(body, 1.0, -2.0, 0.5)[None] * rng.uniform(0.5, 2, (3, 1, 1))
    predicted = equilibrium.linear_response(force) * (1 + 1e-3 * rng.normal(size=force.shape))
    predicted[2] *= -40  # inverted cells
    blocks = BlockSolve(Compliance(body, MATERIAL))
    by_arrays = FastEstimate(equilibrium)
    monkeypatch.setattr(Equilibrium, "undeformed", None)
    by_tensors = FastEstimate(equilibrium, blocks)
    one = by_arrays.with_stability(force, predicted)
    other = by_tensors.with_stability(force, predicted)
    assert np.isinf(one[0][2]).any()
    for expected, found in zip(one, other, strict=True):
        known = np.isfinite(expected)
        np.testing.assert_array_equal(np.isfinite(found), known)
        size = np.abs(expected[known]).max()
        np.testing.assert_allclose(found[known], expected[known], atol=1e-4 * size)
    np.testing.assert_allclose(by_tensors(force, predicted), other[0])
