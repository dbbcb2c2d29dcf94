"""Bodies whose parts are joined at less than a facet: which are mechanisms."""

from __future__ import annotations

import numpy as np
import pytest

from datagen.cases.rigid_motions import motion_problem
from shared_schema.common.bodies.groups import RawMesh
from shared_schema.common.bodies.reference_cells import CORNERS

QUAD = np.array(CORNERS["quad"], float)
CUBE = np.array(CORNERS["hexahedron"], float)


def joined(corner: np.ndarray, origins: list[tuple[float, ...]]) -> RawMesh:
    """Unit cells at some places, equal corners in common."""
    every = np.concatenate([corner + origin for origin in origins])
    x, number = np.unique(every, axis=0, return_inverse=True)
    kind = "quad" if corner.shape[1] == 2 else "hexahedron"
    return RawMesh(x, number.reshape(len(origins), -1), kind)


def problem(mesh: RawMesh, held: np.ndarray) -> str | None:
    return motion_problem(mesh, np.repeat(held[:, None], mesh.coordinates.shape[1], axis=1))


def test_a_hinge_in_the_plane() -> None:
    """Two squares at one node: the second turns about it, unless it is held at a second node."""
    mesh = joined(QUAD, [(0, 0), (1, 1)])
    x = mesh.coordinates
    found = str(problem(mesh, x[:, 0] == 0))
    assert "the part at 1,2 can still move or turn, it shares 1 nodes but no facet" in found
    assert "the first at 1,1; expected it to be held or joined by facets" in found
    assert problem(mesh, (x[:, 0] == 0) | ((x[:, 0] == 2) & (x[:, 1] == 2))) is None


def test_three_hinges_are_a_triangle_and_four_a_mechanism() -> None:
    """Squares about a hole, joined at corners: three hinges in a ring are stiff, four are not.

    A ring of n bodies with n hinges in the plane has 3 n − 2 n − 3 = n − 3 motions of its own.
    """
    ring = joined(QUAD, [(0, 0), (1, 1), (2, 0), (1, -1)])
    assert "can still move or turn" in str(problem(ring, ring.coordinates[:, 0] == 0))
    two = joined(QUAD, [(0, 0), (1, 0), (2, 1), (1, 2), (0, 2), (-1, 1)])
    assert "can still move" in str(problem(two, two.coordinates[:, 1] == 0))
    legs = [[0, 0], [4, 0], [2, 3], [2, 0.2], [3, 1.6], [1, 1.6]]
    triangle = RawMesh(
        np.array(legs, float), np.array([[0, 1, 3], [1, 2, 4], [2, 0, 5]]), "triangle"
    )
    one_held = np.isin(np.arange(6), [0, 1])
    assert problem(triangle, one_held) is None
    assert "can still move" in str(problem(triangle, np.arange(6) == 0))


@pytest.mark.parametrize(
    ("origin", "shared"), [((1, 1, 0), 2), ((1, 1, 1), 1)], ids=["edge", "node"]
)
def test_a_hinge_in_space(origin: tuple[float, ...], shared: int) -> None:
    """Cubes with an edge in common turn about it, those with a node in every direction."""
    mesh = joined(CUBE, [(0, 0, 0), origin])
    x = mesh.coordinates
    assert f"shares {shared} nodes but no facet" in str(problem(mesh, x[:, 0] == 0))
    assert problem(mesh, (x[:, 0] == 0) | (x[:, 0] == 2)) is None
    beside = joined(CUBE, [(0, 0, 0), (1, 0, 0)])
    assert problem(beside, beside.coordinates[:, 0] == 0) is None


def test_three_nodes_in_common_hold_a_part() -> None:
    """Tetrahedra of two parts with three nodes in common but no facet cannot move."""
    x = np.array(
        [
            [0, 0, 0],
            [2, 0, 0],
            [0, 2, 0],
            [0, 0, -2],
            [2, 0, -2],
            [0, 2, -2],
            [0, 0, 2.0],
            [2, 2, 2],
        ]
    )
    cells = np.array([[0, 3, 4, 5], [0, 1, 4, 5], [0, 1, 2, 5], [0, 1, 6, 7], [0, 2, 6, 7]])
    mesh = RawMesh(x, cells, "tetra")
    assert problem(mesh, np.isin(np.arange(8), [3, 4, 5])) is None
