"""Regions against nodes counted by hand."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from datagen.mesh.regions import Region

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
