"""Script for an environment with pyplaid: files of unit cells as PLAID's 2D_MultiScHypEl.

The last cell is the test split, without its solution, as the organisers publish it.
"""

from __future__ import annotations

import sys
from pathlib import Path

import CGNS.PAT.cgnslib as CGL  # noqa: N812
import numpy as np
from plaid import Sample
from plaid.infos import Infos
from plaid.storage import save_to_disk

FIELDS = ("u1", "u2", "P11", "P12", "P22", "P21", "psi")
PATHS = sorted(Path(sys.argv[1]).glob("*.npz"))


def make(number: int) -> Sample:
    arrays = np.load(PATHS[number])
    sample, place = Sample(), {"zone": "Zone", "base": "Base_2_2"}
    sample.init_base(2, 2, "Base_2_2")
    nodes, triangles = arrays["coordinates"], arrays["triangles"]
    shape = np.array([[len(nodes), len(triangles), 0]], dtype=np.int64, order="F")
    zone = sample.init_zone(shape, **place)
    sample.set_nodes(nodes, **place)
    numbers = np.array([1, len(triangles)])
    CGL.newElements(zone, "Elements_TRI_3", "TRI_3", numbers, triangles.ravel() + 1)
    for name, value in zip(("C11", "C12", "C22"), arrays["stretch"], strict=True):
        sample.add_global(name, float(value))
    if number < len(PATHS) - 1:
        sample.add_global("effective_energy", float(arrays["energy"]))
        for name, values in zip(FIELDS, arrays["fields"].T, strict=True):
            sample.add_field(name, values.copy(), **place)
    return sample


if __name__ == "__main__":
    last = len(PATHS) - 1
    ids = {"train": list(range(last)), "test": [last]}
    save_to_disk(sys.argv[2], make, ids, Infos(owner="They", license="CC0"), backend="cgns")
