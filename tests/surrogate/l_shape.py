"""An L of 8 nodes on a 3 × 3 grid whose corner (2, 2) is empty; the column x = 0 is clamped."""

from __future__ import annotations

import numpy as np

from shared_schema.grid import Grid
from surrogate.mechanics.body.geometry import Geometry

NODE_AT = np.array([[0, 1, 2], [3, 4, 5], [6, 7, -1]])
L_SHAPE = Geometry(
    coordinates=np.argwhere(NODE_AT >= 0).astype(np.float64),
    cells=np.array([[0, 3, 4, 1], [1, 4, 5, 2], [3, 6, 7, 4]]),
    cell_type="quad",
    clamped=np.arange(8) < 3,
    loadable=np.isin(np.arange(8), (4, 5, 7)),
    grid=Grid.of_nodes(NODE_AT),
)
