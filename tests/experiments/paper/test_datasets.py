from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from experiments.framework.experiment import Findings
from experiments.paper.datasets import agree, draw_padding
from experiments.paper.published_numbers import PAPER
from shared_schema.grid import Grid
from surrogate.mechanics.body.geometry import Geometry


def test_numbers_are_those_of_the_made_up_datasets(result_of: Callable[[str], Findings]) -> None:
    """8 x 4 and 8 x 4 x 4 nodes, 60 samples of which 12 are tests, forces up to 2.5 N."""
    result = result_of("datasets")
    table, others = result.tables
    plane, space = ("64", "−2.5 to 2.5", "48 + 12", 0), ("384", "−2.5 to 2.5", "48 + 12", 0)
    assert [row[2:] for row in table.rows[::2]] == [plane, plane, plane, space]
    assert {row[2:] for row in others.rows} == {(60, 0)}
    assert not any(claim.holds for claim in result.claims)


def test_the_papers_rows(result_of: Callable[[str], Findings]) -> None:
    """Table "tab:datasets" of the paper; 256 are those of the padded L-shape."""
    rows = [row[2:5] for row in result_of("datasets").tables[0].rows[1::2]]
    assert rows == [
        ("128", "−2.5 to 2.5", "5700 + 300"),
        ("128", "−1 to 1", "3800 + 200"),
        ("160 (256)", "−1 to 1", "3800 + 200"),
        ("12096", "−2 to 2", "33688 + 1782"),
    ]


@pytest.mark.parametrize(
    ("change", "agrees"),
    [
        ({}, True),
        ({"training_samples": 33696, "test_samples": 1774}, True),  # 5.00 %, not 5.02 %
        ({"training_samples": 33600, "test_samples": 1870}, False),
        ({"test_samples": 1781}, False),
        ({"force_range_newton": (-2.0, 2.5)}, False),
        ({"dofs": 12093}, False),
    ],
)
def test_what_agrees_with_the_paper(change: dict[str, Any], agrees: bool) -> None:
    paper = PAPER.datasets["beam3d"]
    assert agree(paper.model_copy(update=change), paper) is agrees


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
