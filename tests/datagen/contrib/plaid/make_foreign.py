"""Script for an environment with pyplaid: a dataset of somebody else.

A square of two triangles in space, with z = 0; fields fx, fy, ux, uy; no tags, no numbers. With
`several` each sample has another mesh.
"""

from __future__ import annotations

import sys

import CGNS.PAT.cgnslib as CGL  # noqa: N812
import numpy as np
from plaid import Sample
from plaid.infos import Infos
from plaid.storage import save_to_disk

NODES = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
CELLS = np.array([[0, 1, 2], [0, 2, 3]])


def make(number: int) -> Sample:
    sample, place = Sample(), {"zone": "Mesh", "base": "Base_2_3"}
    sample.init_base(2, 3, "Base_2_3")
    zone = sample.init_zone(np.array([[4, 2, 0]], dtype=np.int64, order="F"), **place)
    sample.set_nodes(NODES * (1 + number if "several" in sys.argv else 1), **place)
    CGL.newElements(zone, "Elements_TRI_3", "TRI_3", np.array([1, 2]), CELLS.ravel() + 1)
    force = np.array([0, 0, 0.5 * number, -0.25 * number])
    for name, values in (("fx", force), ("fy", 0 * force), ("ux", 2 * force), ("uy", 0.1 * force)):
        sample.add_field(name, values, **place)
    return sample


if __name__ == "__main__":
    ids = {"train": [1, 2, 3], "test": [4, 5]}
    save_to_disk(sys.argv[1], make, ids, Infos(owner="They", license="CC0"), backend="cgns")
