from __future__ import annotations

import numpy as np

from experiments.paper.datasets import draw_padding
from shared_schema.grid import Grid
from surrogate.mechanics.body.geometry import Geometry


def test_every_node_stands_in_its_mesh_and_on_its_grid_point() -> None:
    """Three quads of an L of 8 nodes, on a grid of 3 x 3: one point has no node."""
    coordinates = np.array(
        [(0, 0), (2, 0), (2, 2), (1, 2), (0, 1), (1, 0), (2, 1), (1, 1)], dtype=float
    )
    cells = np.array([(0, 5, 7, 4), (5, 1, 6, 7), (7, 6, 2, 3)])
    none = np.zeros(8, dtype=bool)
    grid = Grid.from_coordinates(coordinates)
    figure = draw_padding(Geometry(coordinates, cells, "quad", none, none, grid))
    for axes in figure.axes:
        places = {int(text.get_text()): text.get_position() for text in axes.texts}
        assert places == {number: tuple(place) for number, place in enumerate(coordinates)}
    *_, empty = figure.axes[1].collections
    assert np.asarray(empty.get_offsets()).tolist() == [[0, 2]]
