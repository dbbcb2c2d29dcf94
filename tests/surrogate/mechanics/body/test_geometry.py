from __future__ import annotations

import numpy as np
import pytest

from shared_schema.common.bodies.command_loads import command_loads
from shared_schema.common.bodies.groups import GroupParts, group_arrays
from shared_schema.grid import grid_arrays
from surrogate.learning.data.body_check import differing_array
from surrogate.learning.data.dataset import Dataset
from surrogate.mechanics.body.geometry import Geometry
from tests.surrogate.l_shape import L_SHAPE


def test_free_mask_leaves_out_clamped_and_empty_points() -> None:
    expected = [[False, False, False], [True, True, True], [True, True, False]]
    assert L_SHAPE.free_mask.tolist() == expected
    assert L_SHAPE.dimension == 2


def test_tip_is_the_loadable_node_farthest_from_the_supports() -> None:
    """Nodes 6 and 7 are 2 m away; only node 7 is loadable."""
    assert L_SHAPE.tip == 7


def test_tensors_round_trip(dataset_3d: Dataset) -> None:
    for geometry in (L_SHAPE, dataset_3d.geometry):
        found = Geometry.from_tensors(geometry.tensors(), geometry.cell_type)
        assert differing_array(geometry.arrays(), found.arrays()) is None
        assert found.arrays().keys() == geometry.arrays().keys()
        assert found.clamped.dtype == np.bool_
        np.testing.assert_array_equal(found.loadable, geometry.loadable)


def test_groups_hold_their_facets_and_cells(dataset_3d: Dataset) -> None:
    """Both faces of a plate of 2 × 1 × 1 hexahedra have all its nodes, a facet of each cell each.

    A traction of 1 N on both, of 4 m² together, is a quarter of 1/4 N at each corner.
    """
    x = np.array([(i, j, k) for k in (0, 1) for j in (0, 1) for i in (0, 1, 2)], dtype=float)
    cells = np.array([(n, n + 1, n + 4, n + 3, n + 6, n + 7, n + 10, n + 9) for n in (0, 1)])
    faces = np.concatenate([cells[:, :4], cells[:, 4:]])
    parts = GroupParts(np.sort(faces, axis=1), np.empty(0, dtype=np.int64))
    every = np.ones(12, dtype=bool)
    arrays = group_arrays({"faces": every}, cells, "hexahedron", {"faces": parts})
    arrays |= {"mesh/coordinates": x, "mesh/cells": cells}
    arrays |= {"mesh/clamped": ~every, "mesh/loadable": every}
    grid = grid_arrays(dataset_3d.geometry.grid)
    geometry = Geometry.from_arrays(arrays | grid, "hexahedron")
    again = Geometry.from_tensors(geometry.tensors(), "hexahedron")
    for each in (geometry, again):
        body = each.loaded_body
        assert sorted(map(sorted, body.facets_of("faces").tolist())) == sorted(
            parts.facets.tolist()
        )
        force = command_loads(body, "faces:0,0,1").forces[:, 2]
        assert force == pytest.approx(np.where(x[:, 0] == 1, 1 / 8, 1 / 16))
