from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from shared_schema.grid import Grid
from surrogate.data.dataset import Dataset
from surrogate.data.geometry import Geometry

# An L of 8 nodes: the grid is 3 × 3 with the corner (2, 2) empty, the column x = 0 clamped.
NODE_AT = np.array([[0, 1, 2], [3, 4, 5], [6, 7, -1]])
L_SHAPE = Geometry(
    coordinates=np.argwhere(NODE_AT >= 0).astype(np.float64),
    cells=np.array([[0, 3, 4, 1], [1, 4, 5, 2], [3, 6, 7, 4]]),
    cell_type="quad",
    clamped=np.arange(8) < 3,
    loadable=np.isin(np.arange(8), (4, 5, 7)),
    grid=Grid.of_nodes(NODE_AT),
)


def test_free_mask_leaves_out_clamped_and_empty_points() -> None:
    expected = [[False, False, False], [True, True, True], [True, True, False]]
    assert L_SHAPE.free_mask.tolist() == expected
    assert L_SHAPE.dimension == 2


def test_tip_is_the_loadable_node_farthest_from_the_supports() -> None:
    """Nodes 6 and 7 are 2 m away, of which 7 alone may be loaded."""
    assert L_SHAPE.tip == 7


def test_tensors_round_trip(dataset_3d: Dataset) -> None:
    for geometry in (L_SHAPE, dataset_3d.geometry):
        found = Geometry.from_tensors(geometry.tensors(), geometry.cell_type)
        assert not found.differs_from(geometry)
        assert found.clamped.dtype == np.bool_
        np.testing.assert_array_equal(found.loadable, geometry.loadable)


@pytest.mark.parametrize(
    ("name", "index", "value"),
    [("coordinates", (5, 0), 1.5), ("cells", (0, 0), 7), ("clamped", 5, True)],
)
def test_difference_is_seen(name: str, index: Any, value: Any) -> None:
    assert not L_SHAPE.differs_from(replace(L_SHAPE))
    changed = getattr(L_SHAPE, name).copy()
    changed[index] = value
    assert L_SHAPE.differs_from(replace(L_SHAPE, **{name: changed}))


def test_difference_of_the_grid_is_seen() -> None:
    assert L_SHAPE.differs_from(replace(L_SHAPE, grid=Grid.of_nodes(NODE_AT.T.copy())))
    assert L_SHAPE.differs_from(replace(L_SHAPE, grid=Grid.of_nodes(NODE_AT[:, [0, 2, 1]])))
