"""Script: write arrays as a PLAID dataset with pyplaid.

It runs in an environment with pyplaid, and imports nothing of this project::

    python write_plaid.py FOLDER OUT

FOLDER has ``about.json`` and the arrays as ``.npy`` files (see `datagen.contrib.plaid.exporting`).
Every sample is a CGNS tree with one base and one zone: coordinates, elements, the nodal tags
``clamped`` and ``loadable``, and the fields ``force_x``, … and ``displacement_x``, … at the nodes.
Globals are ``sample_number``, the parameters of a shape, and ``stable`` (1 or 0) where it is known.
A hidden sample, whose displacements are NaN, has neither these nor ``stable``.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import CGNS.PAT.cgnskeywords as CGK  # noqa: N812 - as everybody calls them
import CGNS.PAT.cgnslib as CGL  # noqa: N812
import CGNS.PAT.cgnsutils as CGU  # noqa: N812
import numpy as np
from plaid import ProblemDefinition, Sample
from plaid.infos import DataProduction, Infos
from plaid.storage import save_to_disk

FIELDS = ("force", "displacement")
TAGS = ("clamped", "loadable")
ZONE = "Zone"


class Maker:
    """Function that makes a sample by its row.

    Parameters
    ----------
    folder : Path
        Folder of the arrays.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.about = json.loads((folder / "about.json").read_text(encoding="utf-8"))
        self.axes = "xyz"[: self.about["dimension"]]
        self.base = f"Base_{len(self.axes)}_{len(self.axes)}"
        names = (*TAGS, "coordinates", "cells", "number", "parameters", *FIELDS)
        self.arrays = {name: np.load(folder / f"{name}.npy", mmap_mode="r") for name in names}
        stable = folder / "stable.npy"
        self.stable = np.load(stable) if stable.exists() else None

    def __call__(self, row: int) -> Sample:
        """Make the sample of a row."""
        arrays, dimension = self.arrays, len(self.axes)
        coordinates, cells = arrays["coordinates"], arrays["cells"]
        coordinates = coordinates[row] if coordinates.ndim == 3 else coordinates
        sample = Sample()
        sample.init_base(dimension, dimension, self.base)
        shape = np.array([[len(coordinates), len(cells), 0]], dtype=np.int64, order="F")
        zone = sample.init_zone(shape, zone=ZONE, base=self.base)
        place = {"zone": ZONE, "base": self.base}
        sample.set_nodes(np.array(coordinates), **place)
        kind = self.about["element"]
        numbers = np.array([1, len(cells)], dtype=np.int64)
        CGL.newElements(zone, f"Elements_{kind}", kind, numbers, np.ravel(cells) + 1)
        conditions = CGL.newZoneBC(zone)
        for tag in TAGS:
            told = CGU.setStringAsArray("UserDefined")
            condition = CGU.newNode(tag, told, [], CGK.BC_ts, conditions)
            CGL.newPointList(condition, "PointList", np.array(arrays[tag])[None] + 1)
            CGL.newGridLocation(condition, "Vertex")
        is_hidden = bool(np.isnan(arrays["displacement"][row]).any())
        for field in FIELDS[:1] if is_hidden else FIELDS:
            for axis, values in zip(self.axes, arrays[field][row].T, strict=True):
                sample.add_field(f"{field}_{axis}", np.array(values), **place)
        sample.add_global("sample_number", int(arrays["number"][row]))
        for name, value in zip(self.about["parameters"], arrays["parameters"][row], strict=True):
            sample.add_global(name, float(value))
        if self.stable is not None and not is_hidden:
            sample.add_global("stable", int(self.stable[row]))
        return sample

    def features(self, field: str) -> list[str]:
        """Paths of the components of a field."""
        return [f"{self.base}/{ZONE}/VertexFields/{field}_{axis}" for axis in self.axes]


def main(folder: Path, out: Path) -> None:
    """Write the dataset with its splits, its problem definition and what is known about it."""
    maker = Maker(folder)
    about = maker.about
    known = "validation" if "validation" in about["splits"] else "test"
    problem = ProblemDefinition(
        input_features=[f"Global/{name}" for name in about["parameters"]] + maker.features("force"),
        output_features=maker.features("displacement"),
        train_split={"train": "all"},
        test_split={known: "all"},  # one with displacements
    )
    infos = Infos(
        owner=about["owner"],
        license=about["license"],
        data_production=DataProduction(
            type="simulation", physics=about["physics"], simulator=about["simulator"]
        ),
        data_description=about["description"],
    )
    save_to_disk(
        out,
        maker,
        about["splits"],
        infos,
        backend=about["backend"],
        pb_defs={"displacement": problem},
    )


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
