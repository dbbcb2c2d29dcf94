"""Cells that are no mesh: repeated ones, facets of three, and cells that a node has turned over."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from shared_schema.common.bodies.cells import cell_names, conformity_problem

SQUARE = np.array([[0.0, 0], [1, 0], [1, 1], [0, 1], [2, 0], [2, 1]])
QUADS = np.array([[0, 1, 2, 3], [1, 4, 5, 2]])
CUBES = np.array([[x, y, z] for z in (0.0, 1.0) for y in (0.0, 1.0) for x in (0.0, 1.0, 2.0)])
HEXAHEDRA = np.array([[0, 1, 4, 3, 6, 7, 10, 9], [1, 2, 5, 4, 7, 8, 11, 10]])
FAN = np.array([[0.0, 0], [1, 0], [1, 1], [0, 1], [0.4, 0.3]])
TRIANGLES = np.array([[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]])
SIMPLEX = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 1]])
TETRA = np.array([[0, 1, 2, 3], [4, 2, 1, 3]])
MESHES: dict[str, Any] = {
    "quad": (SQUARE, QUADS),
    "hexahedron": (CUBES, HEXAHEDRA),
    "triangle": (FAN, TRIANGLES),
    "tetra": (SIMPLEX, TETRA),
}
MIRRORED = {  # the same cells, numbered against VTK's order
    "quad": [0, 3, 2, 1],
    "triangle": [0, 2, 1],
    "tetra": [0, 2, 1, 3],
    "hexahedron": [0, 3, 2, 1, 4, 7, 6, 5],
}


@pytest.mark.parametrize("cell_type", MESHES)
def test_cells_may_be_numbered_in_either_direction(cell_type: str) -> None:
    """As a whole block, or one alone: what counts is where a cell lies."""
    x, cells = MESHES[cell_type]
    assert conformity_problem(x, cells, cell_type) is None
    turned = cells[:, MIRRORED[cell_type]]
    assert conformity_problem(x, turned, cell_type) is None
    turned[1] = cells[1]
    assert conformity_problem(x, turned, cell_type) is None


@pytest.mark.parametrize("cell_type", MESHES)
def test_repeated_cells(cell_type: str) -> None:
    """The first cell once more, in another order of its nodes."""
    x, cells = MESHES[cell_type]
    again = np.concatenate([cells, cells[:1, MIRRORED[cell_type]]])
    found = conformity_problem(x, again, cell_type)
    assert found == f"cells 0, {len(cells)}: the same nodes, expected each cell once"


@pytest.mark.parametrize(
    ("x", "cells", "cell_type", "said"),
    [
        (
            np.array([[0.0, 0], [1, 0], [0, 1], [0, -1], [1, 1]]),
            np.array([[0, 1, 2], [0, 1, 3], [0, 1, 4]]),
            "triangle",
            "cells 0, 1, 2: more than two share a facet (at the first, cells 0, 1, 2)",
        ),
        (
            np.concatenate([SIMPLEX, [[2.0, 2, 2]]]),
            np.array([[0, 1, 2, 3], [4, 2, 1, 3], [5, 2, 1, 3]]),
            "tetra",
            "cells 0, 1, 2: more than two share a facet",
        ),
        (SQUARE, np.array([[0, 1, 2, 6]]), "quad", "cell 0: a node outside 0 … 5"),
        (SQUARE, np.array([[0, 1, 2, -1]]), "quad", "cell 0: a node outside 0 … 5"),
        (SQUARE, np.array([[0, 1, 2, 2]]), "quad", "cell 0: a node twice, expected 4 different"),
        (SQUARE, QUADS, "triangle", "cells of type 'triangle' with 4 nodes in 2 dimensions"),
        (SQUARE, QUADS[:0], "quad", "no cells, expected some"),
        (SQUARE, QUADS, "cube", "cells of type 'cube' with 4 nodes in 2 dimensions"),
    ],
)
def test_cells_that_are_no_mesh(x: Any, cells: Any, cell_type: str, said: str) -> None:
    assert said in str(conformity_problem(x, cells, cell_type))


@pytest.mark.parametrize(
    ("cell_type", "node", "position", "wrong"),
    [
        ("triangle", 4, (0.5, -0.2), "cell 0"),  # the middle node below the bottom edge
        ("tetra", 4, (0.1, 0.1, 0.1), "cell 1"),  # the tip of the second in the first
    ],
)
def test_a_moved_node_turns_a_cell_over(
    cell_type: str, node: int, position: tuple[float, ...], wrong: str
) -> None:
    x, cells = MESHES[cell_type]
    moved = x.copy()
    moved[node] = position
    assert conformity_problem(moved, cells, cell_type) == (
        f"{wrong}: turned over, on the same side of a facet as the neighbour there, expected the "
        "opposite side"
    )


def test_many_cells_are_named_by_the_first() -> None:
    assert cell_names(np.arange(20) > 4) == "15 cells (5, 6, 7, 8, 9, 10, …)"
