"""Bands against dense matrices."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from surrogate.mechanics.matrices.factors import BandCholesky
from surrogate.mechanics.matrices.layout import Layout
from tests.surrogate.mechanics.bodies import box


@pytest.mark.parametrize("cell_type", ["quad", "tetra"])
def test_assembled_and_solved(cell_type: str) -> None:
    """Random positive cell matrices, added into a dense matrix cell by cell."""
    geometry = box(cell_type)
    d, rng = geometry.dimension, np.random.default_rng(0)
    layout = Layout.of(geometry.coordinates, geometry.cells, geometry.held)
    roots = rng.normal(size=(2, *2 * (len(geometry.cells),), 1))[:, :, 0]
    width = geometry.cells.shape[1] * d
    roots = rng.normal(size=(2, len(geometry.cells), width, width))
    entries = roots @ roots.swapaxes(2, 3)
    dofs = (d * geometry.cells[:, :, None] + np.arange(d)).reshape(len(geometry.cells), -1)
    tangents = layout.assembled(torch.from_numpy(entries))
    right = rng.normal(size=len(layout.dofs))
    assert np.array_equal(np.sort(layout.dofs), np.flatnonzero(np.repeat(~geometry.clamped, d)))
    for tangent, matrices in zip(tangents, entries, strict=True):
        dense = np.zeros(2 * (geometry.coordinates.size,))
        for cell, matrix in zip(dofs, matrices, strict=True):
            dense[np.ix_(cell, cell)] += matrix
        dense = dense[np.ix_(layout.dofs, layout.dofs)]
        expected = np.linalg.solve(dense, right)
        np.testing.assert_allclose(layout.matrix(tangent).toarray(), dense, atol=1e-12)
        np.testing.assert_array_equal(layout.diagonal(tangent), layout.matrix(tangent).diagonal())
        factor = layout.factor(tangent)
        assert isinstance(factor, BandCholesky)
        np.testing.assert_allclose(factor.solve(right), expected, rtol=1e-7, atol=1e-9)


@pytest.mark.parametrize("columns", [1, 20])
def test_in_single_precision(columns: int) -> None:
    """A stiff chain, 2 on the diagonal and -1 beside it: rounding by the condition number."""
    n, rng = 40, np.random.default_rng(0)
    band = np.array([[2.0, -1.0]] * n)
    factor = BandCholesky.of(band)
    assert factor is not None
    right = rng.normal(size=(n, columns))
    found = factor.single.solve(right.astype(np.float32))
    assert found.dtype == np.float32
    expected = factor.solve(right)
    condition = 4 * (n / np.pi) ** 2
    atol = condition * np.finfo(np.float32).eps * np.abs(expected).max()
    np.testing.assert_allclose(found, expected, rtol=0, atol=atol)


def test_few_right_hand_sides_are_solved_for_by_blocks() -> None:
    """Four; the matrix is 2 on its diagonal."""
    factor = BandCholesky.of(np.hstack([np.full((40, 1), 2.0), np.zeros((40, 20))]))
    assert factor is not None
    for columns, by_blocks in ((3, False), (4, True)):
        some = np.ones((40, columns))
        np.testing.assert_allclose(factor.solve(some), 0.5)
        np.testing.assert_allclose(factor.single.solve(some.astype(np.float32)), 0.5, rtol=1e-6)
        assert ("_blocks" in vars(factor.single)) is ("_blocks" in vars(factor)) is by_blocks


def test_indefinite_matrix() -> None:
    """The band of [[1, 2], [2, 1]], whose eigenvalues are 3 and -1."""
    assert BandCholesky.of(np.array([[1.0, 2.0], [1.0, 0.0]])) is None
    factor = BandCholesky.of(np.array([[2.0, 1.0], [2.0, 0.0]]))  # eigenvalues 3 and 1
    assert factor is not None
    np.testing.assert_allclose(factor.solve(np.array([3.0, 0.0])), [2.0, -1.0])


def test_width_of_a_beam() -> None:
    """Numbered across the beam, node (i, j) has its farthest neighbour at (i + 1, j + 1)."""
    geometry = box("quad")
    layout = Layout.of(geometry.coordinates, geometry.cells, geometry.held)
    assert layout.width is not None
    assert layout.width <= (4 + 1) * 2 + 1
