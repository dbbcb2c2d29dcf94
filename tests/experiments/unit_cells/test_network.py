"""Fields of unit cells on a grid, and the network that predicts them."""

from __future__ import annotations

import numpy as np
import torch

from experiments.unit_cells.network import (
    POINTS,
    FieldPredictor,
    OnGrid,
    geometry_views,
    interpolated,
    places_of,
)
from experiments.unit_cells.unit_cell import scores
from tests.experiments.unit_cells.test_mechanics import stretched, with_hole


def test_linear_fields_are_exact_there_and_back() -> None:
    cell = with_hole(1.1, 0.0, 1.0)
    linear = cell.coordinates @ np.array([[1.0, 3.0], [-2.0, 0.5]])
    on_grid = OnGrid(cell)(linear)
    ticks = 1 + np.linspace(0, 1, POINTS)
    outside = np.abs(ticks - 1.5) < 0.15
    hole = outside[:, None] & outside
    assert (on_grid[:, hole] == 0).all()
    x, y = ticks[:, None], ticks
    body = OnGrid(cell).inside.reshape(POINTS, POINTS)
    np.testing.assert_allclose(on_grid[0][body], (x - 2 * y)[body], atol=1e-12)
    whole = torch.from_numpy(np.stack(np.broadcast_arrays(x - 2 * y, 3 * x + 0.5 * y))).float()
    np.testing.assert_allclose(interpolated(whole, places_of(cell)).numpy(), linear, atol=1e-5)


def test_distance_from_the_hole() -> None:
    """Positive in the body, largest in a corner of the square, negative in the hole."""
    distance = OnGrid(with_hole(1.1, 0.0, 1.0)).distance()[0]
    assert distance.argmax() in (0, POINTS - 1, POINTS**2 - POINTS, POINTS**2 - 1)
    middle = POINTS // 2
    assert -0.22 < distance[middle, middle] < -0.15


def test_network_learns_and_holds_the_outer_edge() -> None:
    cells = [stretched(1 + 0.03 * k, 0.01 * k, 1 - 0.02 * k) for k in range(1, 5)]
    views = [geometry_views(cell) for cell in cells]
    begin = scores(cells, [view.begin for view in views])["total"]
    predictor = FieldPredictor(cells, views, channels=4, epochs=200, seed=0)
    found = [predictor.predict(*each) for each in zip(cells, views, strict=True)]
    assert scores(cells, found)["total"] < 0.5 * begin
    outer = cells[0].is_outer
    np.testing.assert_array_equal(found[0].fields[outer, :2], cells[0].homogeneous[outer])
