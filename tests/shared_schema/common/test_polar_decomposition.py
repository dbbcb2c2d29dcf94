"""Cofactors and rotations of deformation gradients, against formulas of the same terms."""

from __future__ import annotations

import numpy as np
import pytest

from shared_schema.common.bodies.polar_decomposition import cofactors, rotations


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
