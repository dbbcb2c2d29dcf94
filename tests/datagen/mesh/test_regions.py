"""Regions against nodes counted by hand."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from datagen.mesh.regions import Region
from shared_schema.common.bodies.cells import boundary_facets

GRID = np.stack(np.meshgrid([0.0, 1.0, 2.0], [0.0, 1.0], indexing="ij"), axis=-1).reshape(-1, 2)


@pytest.mark.parametrize(
    ("region", "count"),
    [
        ({}, 6),
        ({"x": 0}, 2),
        ({"x": "> 0"}, 4),
        ({"x": ">= 0"}, 6),
        ({"x": "< 2"}, 4),
        ({"x": "<= 1", "y": 1}, 2),
        ({"y": 1, "x": "> 0"}, 2),
        ({"x": 0.5}, 0),
    ],
)
def test_selection(region: dict[str, Any], count: int) -> None:
    assert Region(**region).select(GRID).sum() == count


def test_rounding_does_not_move_a_node_over_the_border() -> None:
    """Comparisons have a tolerance of 1e-6 of the size of the mesh."""
    noisy = GRID + 1e-9
    assert Region(x="> 0").select(noisy).sum() == 4
    assert Region(x="<= 2").select(noisy).sum() == 6


@pytest.mark.parametrize("text", ["0 <", "> one", "near 0", "== 1", ">"])
def test_invalid_conditions(text: str) -> None:
    with pytest.raises(ValidationError, match="a comparison such as '> 0'"):
        Region(x=text)


def test_unknown_axis() -> None:
    with pytest.raises(ValidationError, match="w"):
        Region.model_validate({"w": 1})


def test_group_and_coordinates_together() -> None:
    """The region has the nodes of the group that also meet the other conditions."""
    groups = {"side": np.array([0, 1, 4])}
    assert np.flatnonzero(Region(group="side").select(GRID, groups)).tolist() == [0, 1, 4]
    assert np.flatnonzero(Region(group="side", x=0).select(GRID, groups)).tolist() == [0, 1]
    with pytest.raises(ValueError, match="group 'top': the mesh has no such group, but side"):
        Region(group="top").select(GRID, groups)


def test_a_group_is_written_only_where_there_is_one() -> None:
    """Datasets of cases without groups keep their digest."""
    assert Region(x=0).model_dump(mode="json") == {"x": 0.0, "y": None, "z": None}
    assert Region(group="a").model_dump(mode="json")["group"] == "a"


def test_boundary_of_a_square() -> None:
    """Sixteen nodes on the surface of 4 x 4 squares; nine inside."""
    x = np.stack(np.meshgrid(range(5), range(5), indexing="ij"), axis=-1).reshape(-1, 2) / 1.0
    low = np.array([5 * i + j for i in range(4) for j in range(4)])
    cells = np.stack([low, low + 5, low + 6, low + 1], axis=1)
    facets = boundary_facets(cells, "quad")
    on_surface = Region(boundary=True).select(x, facets=facets)
    assert on_surface.sum() == 16
    assert not on_surface[np.all((x > 0) & (x < 4), axis=1)].any()
    assert Region(boundary=True, x="> 0").select(x, facets=facets).sum() == 11
    with pytest.raises(ValueError, match="the facets of the surface are not known"):
        Region(boundary=True).select(x)


def test_unused_keys_are_not_part_of_a_case() -> None:
    """Cases of before keep their digest."""
    assert Region(x="> 0").model_dump() == {"x": "> 0", "y": None, "z": None}
    assert Region(boundary=True).model_dump()["boundary"] is True
