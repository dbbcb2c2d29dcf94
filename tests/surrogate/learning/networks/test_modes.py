"""Leading modes of fields, and scales of their coefficients."""

from __future__ import annotations

import pytest
import torch

from surrogate.learning.networks.modes import ModalSeries, half_whitening, leading_modes


def test_leading_modes_of_a_large_matrix() -> None:
    """The randomised decomposition spans the leading singular vectors."""
    torch.manual_seed(0)
    left, right = torch.linalg.qr(torch.randn(300, 40)).Q, torch.linalg.qr(torch.randn(400, 40)).Q
    snapshots = left * 0.5 ** torch.arange(40) @ right.T
    found = leading_modes(snapshots, 5, seed=0)
    overlap = torch.linalg.svdvals(found @ right[:, :5])
    torch.testing.assert_close(overlap, torch.ones(5))
    assert torch.equal(found, leading_modes(snapshots, 5, seed=0))


def test_half_whitening_by_hand() -> None:
    """Columns of 1, 16 and 0: divided by 1 and 4, then both by the same number; 0 stays."""
    values = torch.tensor([[1.0, 16.0, 0.0], [-1.0, -16.0, 0.0]])
    scaled = values * half_whitening(values)
    torch.testing.assert_close(scaled[0, 1], 4 * scaled[0, 0])
    torch.testing.assert_close(scaled.square().mean(), torch.tensor(1.0))


def test_series_of_known_polynomials() -> None:
    """Polynomials are found from values, and their scaled values are of order one."""
    torch.manual_seed(0)
    a, series = torch.randn(200, 5), ModalSeries((4, 3), 2)
    second = torch.stack([a[:, 0] * a[:, 3], a[:, 1] ** 2 - a[:, 2] * a[:, 1]], dim=1)
    third = torch.stack([a[:, 2] ** 3, 0.1 * a[:, 0] * a[:, 1] * a[:, 2]], dim=1)
    series.fit(a, [second, third])
    found = series(a)
    torch.testing.assert_close(found, [second, third], rtol=1e-4, atol=1e-4)
    scaled = series.scaled(found)
    assert [float(x.square().mean()) for x in scaled] == pytest.approx([1, 1])
    series.in_units_of(torch.tensor(0.5))
    torch.testing.assert_close(series(a)[0], 2 * found[0])
    torch.testing.assert_close(series.scaled(series(a)), scaled)
