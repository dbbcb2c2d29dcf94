"""Every material, element and load by every method, beside the equilibria of `datagen`."""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

import surrogate
from surrogate.learning.inference import export as written
from surrogate.learning.inference.export import load_exported
from surrogate.mechanics.statics.load import given_load
from tests.end_to_end.commands import DATAGEN, ROOT, SURROGATE, execute
from tests.end_to_end.matrix import (
    ACTING,
    DEAD,
    ELEMENTS,
    HELD,
    LOADS,
    MATERIALS,
    OPEN,
    PRESSURE,
    REASONS,
    TOOL,
    Field,
    case_of,
    fields,
    found_in,
    table,
)

Array = NDArray[np.float64]
BODIES = [(m, e, load) for m in MATERIALS for e in ELEMENTS for load in LOADS]
SOUGHT = "4,1"  # where `identify` seeks a force
# writes the dataset and the equilibria of all bodies
FACTORY = """
import json
import sys
from pathlib import Path
import numpy as np
import datagen
from datagen.mesh.mesh_file import MeshFile

read, meshes = MeshFile.raw_mesh, []  # all bodies have one mesh, which is read once
MeshFile.raw_mesh = lambda file: meshes[0] if meshes else meshes.append(read(file)) or meshes[0]
folder = Path(sys.argv[1])
for name, job in json.loads((folder / "jobs.json").read_text()).items():
    datagen.body(job["case"], folder / name / "data")
    for asked, keys in job["asked"].items():
        found = datagen.solve(job["case"], stresses=asked == "acting", **keys)
        stress = {"stress": found.stresses["cauchy"]} if asked == "acting" else {}
        np.savez(folder / name / asked, displacement=found.displacement, **stress)
"""


def asked_of(load: str) -> dict[str, dict[str, Any]]:
    """Equilibria of a body that `datagen` is asked for, by names: arguments of `datagen.solve`."""
    found = {"acting": ACTING[load]}
    beside = {DEAD: [], PRESSURE: ACTING[PRESSURE]["load"]}.get(load)
    if beside is not None:
        found["hold"] = {"load": beside, "held": [HELD]}
        found["tool"] = {"load": beside, "tool": TOOL}
        found["identify"] = {"load": [*beside, *ACTING[DEAD]["load"]]}
    return found


class Body:
    """The run of a body, and the equilibria of the factory."""

    def __init__(self, folder: Path, load: str) -> None:
        self.folder, self.run, self.load = folder, folder / "run", load
        execute(SURROGATE, "train", "series", "--data", folder / "data", "--out", self.run)
        self.model = surrogate.load(self.run)
        keys = ACTING[load]
        self.acting = {"load": keys.get("load", ()), "body_force": keys.get("body_force")}

    def truth(self, asked: str, name: str = "displacement") -> Array:
        """A field of an equilibrium of the factory."""
        with np.load(self.folder / f"{asked}.npz") as found:
            return np.asarray(found[name])

    def error(self, displacement: Array, asked: str = "acting") -> float:
        """Largest error of a node over the largest displacement."""
        truth = self.truth(asked)
        return largest(displacement - truth) / largest(truth)

    @property
    def beside(self) -> Any:
        """What acts beside a held place, a tool or a force that is sought."""
        return self.acting["load"] if self.load == PRESSURE else ()

    @property
    def forces(self) -> tuple[Array, Array | None]:
        """Forces in N, those between the nodes after the nodal ones, and pressures in Pa."""
        keys = self.acting
        given = given_load(
            self.model.geometry, keys["load"], False, keys["body_force"], needed=True
        )
        between = given.at_rest_between
        parts = [given.at_rest] if between is None else [given.at_rest, between]
        return np.concatenate(parts), np.array([1.0]) if self.load == PRESSURE else None

    @cached_property
    def bounds(self) -> Any:
        """Bounds of the prediction, calibrated on loads of the case."""
        surrogate.calibrate(self.run, loads=20)
        force, pressure = self.forces
        return surrogate.load(self.run).bounds(force, pressure=pressure)


def largest(field: Array) -> float:
    """Largest length of the vectors of a field."""
    return float(np.linalg.norm(field, axis=-1).max())


@pytest.fixture(scope="module")
def bodies(tmp_path_factory: pytest.TempPathFactory) -> Callable[[Field], Body]:
    """Bodies of fields; all datasets and equilibria are made by one process of the factory."""
    folder = tmp_path_factory.mktemp("matrix")
    numbers = {body: str(number) for number, body in enumerate(BODIES)}
    jobs = {numbers[body]: {"case": case_of(*body), "asked": asked_of(body[2])} for body in BODIES}
    for name in jobs:
        (folder / name).mkdir()
    (folder / "jobs.json").write_text(json.dumps(jobs))
    execute(DATAGEN.parent / "python", "-c", FACTORY, folder)
    made: dict[tuple[str, str, str], Body] = {}

    def body_of(field: Field) -> Body:
        if field.body not in made:
            made[field.body] = Body(folder / numbers[field.body], field.body[2])
        return made[field.body]

    return body_of


def series(body: Body) -> None:
    assert body.error(body.model.solve(**body.acting).displacement) < 1e-2


def directions(body: Body) -> None:
    assert body.error(body.model.solve(**body.acting, tolerance=1e-3).displacement) < 1e-3


def fast(body: Body) -> None:
    """The bound holds, and is no more than three times the error."""
    force, pressure = body.forces
    error = largest(body.model.predict(force, pressure=pressure) - body.truth("acting"))
    assert error < float(body.bounds.largest) < 3 * error


def full(body: Body) -> None:
    """The error of a state that is 1 % off is told to a tenth of it."""
    (force, pressure), truth = body.forces, body.truth("acting")
    found = body.model.certify(force, 0.99 * truth, pressure=pressure)
    assert found.refusal(np.inf) is None
    assert largest(found.error + 0.01 * truth) < 0.1 * 0.01 * largest(truth)


def correct(body: Body) -> None:
    assert body.error(body.model.solve(**body.acting, correct=True).displacement) < 1e-6


def stresses(body: Body) -> None:
    """Cauchy stresses of the corrected state."""
    found = body.model.solve(**body.acting, correct=True, stresses=True).stresses["cauchy"]
    expected = body.truth("acting", "stress")
    assert np.abs(found - expected).max() < 1e-6 * np.abs(expected).max()


def page(body: Body) -> None:
    """It estimates errors; `tests.surrogate.page.test_mechanics` has its numbers."""
    assert surrogate.write_page(body.run, body.folder / "page.html").estimates


def export(body: Body) -> None:
    """The exported program predicts as the run does: as it is read to be checked, which is slow."""
    read: list[Any] = []

    def once(path: Path) -> Any:
        read.append(load_exported(path))
        return read[0]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(written, "load_exported", once)
        surrogate.export(body.run, body.folder / "network.pt2", format="pt2")
    force, _ = body.forces
    nodal = torch.from_numpy(force[None, : len(body.model.geometry.coordinates)]).float()
    found = read[0](nodal)["displacement"][0].numpy()
    assert body.error(found) < 1e-2


def hold(body: Body) -> None:
    assert body.error(body.model.solve(body.beside, held=[HELD]).displacement, "hold") < 1e-2


def tool(body: Body) -> None:
    assert body.error(body.model.solve(body.beside, tool=TOOL).displacement, "tool") < 1e-2


def identify(body: Body) -> None:
    """A force of (1, −2) N, from where the nodes of the surface are."""
    nodes = body.model.geometry.surface_nodes
    x = body.model.geometry.coordinates[nodes]
    seen = surrogate.Markers.of(x, x + body.truth("identify")[nodes])
    found = surrogate.identify(body.model, seen, [SOUGHT], body.beside)
    np.testing.assert_allclose(found.values, [1, -2], rtol=1e-2)


CHECKS: dict[str, Callable[[Body], None]] = {
    check.__name__: check
    for check in (
        series,
        directions,
        fast,
        full,
        correct,
        stresses,
        page,
        export,
        hold,
        tool,
        identify,
    )
}


def marked(field: Field) -> Any:
    """The field as a parameter: one that is not right yet has to fail."""
    why = found_in(OPEN, field)
    marks = () if why is None else pytest.mark.xfail(strict=True, reason=why)
    return pytest.param(field, id=str(field), marks=marks)


def test_page_has_the_table() -> None:
    """``python -m tests.end_to_end.matrix`` prints what stands in the page."""
    assert table() in (ROOT / "docs" / "limitations.md").read_text()


@pytest.mark.slow
@pytest.mark.parametrize("field", [marked(field) for field in fields()])
def test_field(field: Field, bodies: Callable[[Field], Body]) -> None:
    """A number beside the factory's equilibrium, or a line that says why there is none."""
    reason = found_in(REASONS, field)
    check, body = CHECKS[field.method], bodies(field)
    if reason is None:
        check(body)
    else:
        with pytest.raises(surrogate.InputError, match=reason):
            check(body)
