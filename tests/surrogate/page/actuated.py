"""A small body in space with a chamber and a cable, and the page of it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

from shared_schema.grid import Grid
from surrogate.learning.data.dataset import Dataset
from surrogate.learning.training.loop import train
from surrogate.mechanics.body.elements_of_case import with_elements
from surrogate.mechanics.body.geometry import Geometry
from surrogate.mechanics.statics.body import Body
from tests.shared_schema.test_actuators import hollow

MATERIAL = {"model": "neo_hookean", "young_modulus": 500, "poisson_ratio": 0.45}
PLACES = [[0.1, 0.2, 2.8], [1.5, 0.2, 2.9], [2.9, 0.2, 2.8]]  # of a cable beside the chamber


def chambered(kinds: tuple[str, str] = ("pressure", "tension"), ambient: float = 1e3) -> Body:
    """A block of 3 m, clamped at x = 0, with a chamber of 1 m³, and a cable along one edge."""
    limits = {"pressure": [-50, 150], "volume": [0.8, 1.5], "gas": [-50, 150]}
    limits |= {"tension": [0, 60], "length": [2.4, 2.8]}
    air: dict[str, Any] = {"chamber": "hole", kinds[0]: limits[kinds[0]]}
    air |= {"ambient": ambient} if kinds[0] == "gas" else {}
    rope = {"cable": PLACES, kinds[1]: limits[kinds[1]]}
    case = {
        "element": "incompressible",
        "material": MATERIAL,
        "actuators": {"air": air, "rope": rope},
    }
    block = hollow()
    x, clamped = block.coordinates, block.groups["side"]
    known = x, block.cells, block.cell_type, clamped, ~clamped, Grid.in_a_row(*x.shape)
    geometry = replace(Geometry(*known), groups=dict(block.groups))
    return Body(with_elements(geometry, case, "consistent"), case)


def run_of(body: Body, dataset: Dataset, folder: Path) -> Path:
    """A run of the load series of a body, in place of that of a dataset."""
    case = {**dataset.manifest.case, "load": [], **body.case}
    manifest = dataset.manifest.model_copy(update={"case": case})
    of_body = replace(dataset, geometry=body.geometry, manifest=manifest)
    train({"model": "series"}, of_body, folder)
    return folder
