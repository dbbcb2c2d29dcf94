from __future__ import annotations

import numpy as np

from surrogate.data.body_check import differing_array
from surrogate.data.dataset import Dataset
from surrogate.data.geometry import Geometry
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
