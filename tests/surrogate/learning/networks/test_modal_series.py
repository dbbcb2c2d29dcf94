"""The load series in modes."""

from __future__ import annotations

import pytest
import torch

from surrogate.learning.networks.modes import ModalSeries


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
