"""No public call writes to what it is given, or reads again what it has returned."""

from __future__ import annotations

import shutil
import warnings
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cached_property, reduce
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

import surrogate
from shared_schema.common.errors import InputError
from shared_schema.dataset_reader import DatasetReader
from shared_schema.tools import Sphere
from surrogate.learning.probabilistic.distribution import Distribution
from surrogate.mechanics.body.geometry import Geometry
from surrogate.mechanics.certify import (
    FastCertificate,
    Intervals,
)
from surrogate.mechanics.descent import Descent
from surrogate.mechanics.descent.aim import Aim
from surrogate.mechanics.statics.body import Body
from surrogate.mechanics.statics.load import Load
from tests.aliasing import require_no_aliases

Array = NDArray[np.float64]
Given = dict[str, Any]


class World:
    """A model, and all that it hands out; `wild` if callables misuse their arguments."""

    def __init__(self, bayes: Path, data: Path, folder: Path, wild: bool) -> None:
        self.model, self.bayes = surrogate.load("beam2d_any"), surrogate.load(bayes)
        self.run, self.data, self.folder, self.wild = bayes, data, folder, wild
        folder.mkdir()
        self.buffer = np.zeros(self.model.geometry.coordinates.shape)

    def shown(self, force: Array) -> Array:
        """A prediction in a buffer, which the next one overwrites."""
        predicted = self.model.predict(force)
        if not self.wild:
            return predicted
        force[...] = self.buffer[...] = np.nan
        self.buffer[...] = predicted
        return self.buffer

    def out(self, name: str) -> Path:
        """A folder that is not there."""
        shutil.rmtree(self.folder / name, ignore_errors=True)
        return self.folder / name

    @cached_property
    def touch(self) -> surrogate.Touch:
        return surrogate.Touch(self.model, corrected=True)

    @cached_property
    def grip(self) -> surrogate.Grip:
        return surrogate.Grip(self.model, {"4,1": [0.02, None]}, corrected=True)

    @cached_property
    def solution(self) -> surrogate.Solution:
        return self.model.solve("4,1:0,-0.5", certify="fast", stresses=True)

    @cached_property
    def dataset(self) -> surrogate.Dataset:
        return surrogate.read_dataset(self.data)

    @cached_property
    def evaluation(self) -> surrogate.Evaluation:
        return surrogate.evaluate(self.run, self.dataset, passes=2, conformal=0.5)

    @cached_property
    def intervals(self) -> Intervals:
        assert self.evaluation.intervals is not None
        return self.evaluation.intervals

    @cached_property
    def comparison(self) -> surrogate.Comparison:
        return surrogate.compare([self.run], dataset=self.dataset, passes=2)

    @cached_property
    def identification(self) -> surrogate.Identification:
        given = arguments()
        markers = surrogate.Markers.of(given["at rest"], given["seen"])
        return surrogate.identify(self.model, markers, ["4,1"], noise=1e-3)

    @cached_property
    def fast(self) -> FastCertificate:
        return self.model.fast_certificate

    @cached_property
    def distribution(self) -> Distribution:
        return self.bayes.predict_distribution(self.force_of_bayes, 2)

    @cached_property
    def force_of_bayes(self) -> Array:
        force = np.zeros(self.bayes.geometry.coordinates.shape)
        force[self.bayes.geometry.tip] = 0.1, -0.2
        return force


def arguments() -> Given:
    """Arrays, tensors, lists and mappings that a caller may give."""
    force = np.zeros((64, 2))
    tip = 1  # at 4, 0
    force[tip] = 0.1, -0.5
    at_rest = np.array([[1.0, 0.5], [2.0, 0.5], [3.0, 0.5], [4.0, 0.5]])
    return {
        "force": force,
        "forces": np.stack([force, -0.5 * force]),
        "tensor": torch.tensor(force),
        "displacement": 0.01 * force,
        "displacements": np.stack([0.01 * force, -0.005 * force]),
        "truth": np.stack([0.011 * force, -0.004 * force]),
        "nodes": np.array([5, 3, 1]),
        "held": {"4,1": [0.02, None]},
        "moved": np.array([[0.03, 0.0]]),
        "body force": np.array([0.0, -0.1]),
        "centre": np.array([3.0, 1.25]),
        "at rest": at_rest,
        "seen": at_rest - np.outer([0.01, 0.04, 0.08, 0.12], [0.0, 1.0]),
        "unknown": ["4,1"],
    }


def tool(given: Given, lower: float = 0.0) -> Sphere:
    """A sphere that pushes the beam from above."""
    x, y = given["centre"]
    return Sphere((x, y - lower), 0.3)


Call = Callable[[World, Given], Any]
OF_BODIES = ["equilibrium", "is_small", "material", "units"]
OF_MODELS = ["fast_certificate", "fast_estimate"]
OF_MODELS += ["bounds_of_components", "has_series", "is_probabilistic", "is_stochastic"]
OF_MODELS += ["precision", "run"]
OF_GEOMETRIES = ["dimension", "free", "free_mask", "held", "loaded_body", "movable", "no_pressure"]
OF_GEOMETRIES += ["surface_facets", "surface_nodes", "surfaces", "tip"]
OF_GEOMETRIES += ["free_at_points", "loaded_points", "points_between", "pressed_points"]
OF_DATASETS = ["body", "folder", "info", "material"]


def attribute(*names: str) -> Call:
    """What a world has under a name, or a part of it."""
    return lambda world, given: reduce(getattr, names, world)


CALLS: dict[str, Call] = {
    # Surrogate
    "Surrogate.predict": lambda w, g: [
        w.model.predict(g["force"]),
        w.model.predict(g["forces"]),
        w.model.predict(g["tensor"]),
        w.model.predict(g["tensor"].clone().requires_grad_(True)),
        w.model.predict(g["force"], nodes="surface"),
        w.model.predict(g["force"], nodes=g["nodes"]),
        w.bayes.predict(w.force_of_bayes),
    ],
    "Surrogate.predict, driven": lambda w, g: [
        w.model.predict(g["forces"], tolerance=1e-6),
        w.model.predict(g["tensor"], budget=1e9, tolerance=1e-6),
    ],
    "Surrogate.solve": lambda w, g: [
        w.model.solve(g["force"], certify="fast", stresses=True),
        w.model.solve(g["tensor"]),
        w.bayes.solve(w.force_of_bayes, passes=2, certify="full"),
    ],
    "Surrogate.solve, stiffness": lambda w, g: [
        w.model.solve(g["force"], young_modulus=1000.0),
        w.model.solve(g["tensor"], young_modulus=1000.0, correct=True, certify="full"),
    ],
    "Surrogate.solve, held": lambda w, g: [
        w.model.solve(g["force"], held=g["held"]),
        w.model.solve(g["force"], held=g["held"], correct=True),
    ],
    "Surrogate.solve, tool": lambda w, g: [
        w.model.solve(g["force"], tool=tool(g)),
        w.model.solve(g["force"], tool=tool(g), correct=True),
    ],
    "Surrogate.solve, body force": lambda w, g: [
        w.model.solve(g["force"], body_force=g["body force"]),
        w.model.solve(g["tensor"], body_force=g["body force"], tolerance=1e-6),
    ],
    "Surrogate.predict_distribution": lambda w, g: w.bayes.predict_distribution(
        w.force_of_bayes, passes=3
    ),
    "Surrogate.averaged_passes": lambda w, g: [
        w.model.averaged_passes(g["forces"]),
        w.bayes.averaged_passes(w.force_of_bayes, 3),
    ],
    "Surrogate.certify": lambda w, g: [
        w.model.certify(g["force"], g["displacement"]),
        w.model.certify(g["forces"], g["displacements"]),
        w.model.certify(g["forces"]),
    ],
    "Surrogate.bounds": lambda w, g: [
        w.model.bounds(g["force"], g["displacement"]),
        w.model.bounds(g["forces"]),
    ],
    "Surrogate.correct": lambda w, g: [
        w.model.correct(g["force"], g["displacement"]),
        w.model.correct(g["force"]),
    ],
    "Surrogate.correct_each": lambda w, g: w.model.correct_each(g["forces"], g["displacements"]),
    "Surrogate.stresses": lambda w, g: [
        w.model.stresses(g["displacement"]),
        w.model.stresses(g["displacements"]),
    ],
    "Surrogate.reactions": lambda w, g: w.model.reactions(g["displacement"], g["force"]),
    "Surrogate.respond": lambda w, g: w.model.respond(Load(g["forces"])),
    # its body
    "Body.read": lambda w, g: Body.read(w.data).geometry.coordinates,
    "Body.certify": lambda w, g: w.model.body.certify(Load(g["forces"]), g["displacements"]),
    "Body.correct": lambda w, g: w.model.body.correct(Load(g["force"]), g["displacement"]),
    "Body.descend": lambda w, g: w.model.body.descend(
        Load(g["force"]), g["displacement"], Aim(1e-6)
    ),
    "Body.one_direction": lambda w, g: w.model.body.one_direction(
        Load(g["force"]), g["displacement"]
    ),
    "Body.stresses": lambda w, g: w.model.body.stresses(g["displacements"]),
    "Body.reactions": lambda w, g: w.model.body.reactions(g["displacement"], g["force"]),
    "Body.stresses_under": lambda w, g: w.model.body.stresses_under(
        Load(g["forces"]), g["displacements"]
    ),
    "Body.reactions_under": lambda w, g: w.model.body.reactions_under(
        Load(g["forces"]), g["displacements"]
    ),
    **{f"Body.{name}": attribute("model", "body", name) for name in OF_BODIES},
    **{f"Surrogate.{name}": attribute("model", name) for name in OF_MODELS},
    "Surrogate.intervals": lambda w, g: w.intervals,
    # frames
    "Touch.move": lambda w, g: [
        w.touch.move(tool(g)),
        w.touch.move(tool(g, 0.01), g["force"]),
        w.touch.move(tool(g, 0.02), predict=w.shown),
        w.touch.move(tool(g, 0.03), predict=w.shown),
        w.touch.move(tool(g, 0.04)),
    ],
    "Touch.correct": lambda w, g: [
        w.touch.correct(tool(g, 0.05), 0.1 * g["force"]),
        w.touch.correct(tool(g, 0.05), 0.1 * g["force"]),
        w.touch.move(tool(g, 0.05)),
    ],
    "Grip.move": lambda w, g: [
        w.grip.move(g["moved"]),
        w.grip.move(g["moved"], g["force"]),
        w.grip.move(g["moved"], g["force"]),
        w.grip.move(2 * g["moved"], predict=w.shown),
        w.grip.move(3 * g["moved"], predict=w.shown),
        w.grip.move(w.grip.displacements),
    ],
    "Grip.correct": lambda w, g: [
        w.grip.correct(g["moved"], g["force"]),
        w.grip.correct(g["moved"], g["force"]),
        w.grip.move(g["moved"], g["force"]),
    ],
    # identification
    "identify": lambda w, g: [
        surrogate.identify(
            w.model,
            surrogate.Markers(g["at rest"], g["seen"]),
            g["unknown"],
            body_force=g["body force"],
            noise=1e-3,
        ),
        surrogate.identify(
            w.model, surrogate.Markers(g["at rest"], g["seen"]), ["tool"], tool=tool(g), noise=1e-3
        ),
    ],
    "Markers.of": lambda w, g: surrogate.Markers.of(g["at rest"], g["seen"]),
    "Markers.moved": lambda w, g: surrogate.Markers(g["at rest"], g["seen"]).moved,
    # solutions
    "Solution.fields": lambda w, g: w.solution.fields(),
    "Solution.largest": lambda w, g: w.solution.largest,
    "Solution.std": lambda w, g: w.bayes.solve(w.force_of_bayes, passes=2).std,
    # certificates
    "Certificate.max_error": lambda w, g: w.model.certify(g["forces"]).max_error,
    "Certificate.mean_error": lambda w, g: w.model.certify(g["forces"]).mean_error,
    "Distribution.fields": lambda w, g: w.distribution.fields(),
    "Distribution.std": lambda w, g: w.distribution.std,
    "FastEstimate.__call__": lambda w, g: w.model.fast_estimate(g["forces"], g["displacements"]),
    "FastEstimate.with_stability": lambda w, g: w.model.fast_estimate.with_stability(
        g["forces"], g["displacements"]
    ),
    "FastCertificate.certify": lambda w, g: [
        w.fast.certify(g["force"], g["displacement"], 0.95),
        w.fast.certify(g["forces"], g["displacements"], 0.95),
    ],
    "FastCertificate.bounds": lambda w, g: w.fast.bounds(
        g["displacements"], g["truth"], g["body force"], 0.95
    ),
    "FastCertificate.measures": lambda w, g: w.fast.measures(
        g["forces"], g["displacements"], g["truth"]
    ),
    "FastCertificate.half_widths": lambda w, g: scaled(w).half_widths(
        g["displacements"], np.abs(g["truth"]), 0.95
    ),
    "FastCertificate.inside": lambda w, g: scaled(w).inside(
        g["forces"], g["displacements"], g["truth"], np.abs(g["truth"]), 0.95
    ),
    "Intervals.bounds": lambda w, g: w.intervals.bounds("marginal", *of_bayes(w), 1e-3),
    "Intervals.measures": lambda w, g: w.intervals.measures(
        *of_bayes(w), 1e-3, *of_bayes(w), w.bayes.geometry.free
    ),
    # bodies and datasets
    **{f"Geometry.{name}": attribute("model", "geometry", name) for name in OF_GEOMETRIES},
    "Geometry.arrays": lambda w, g: w.model.geometry.arrays(),
    "Geometry.tensors": lambda w, g: w.model.geometry.tensors(),
    "Geometry.from_arrays": lambda w, g: read(w),
    "Geometry.from_tensors": lambda w, g: Geometry.from_tensors(
        w.model.geometry.tensors(), w.model.geometry.cell_type
    ),
    "Geometry.nodes_of": lambda w, g: [
        w.model.geometry.nodes_of(g["nodes"]),
        w.model.geometry.nodes_of("surface"),
    ],
    **{f"Dataset.{name}": attribute("dataset", name) for name in OF_DATASETS},
    "read_dataset": lambda w, g: surrogate.read_dataset(w.data),
    "Evaluation.predicted": lambda w, g: evaluated(w).predicted,
    "load": lambda w, g: surrogate.load("beam2d_any").geometry.coordinates,
}


def zoned(model: surrogate.Surrogate | Body, given: Given) -> None:
    with pytest.raises(InputError):
        model.with_young_moduli(given["held"])


def read(world: World) -> Geometry:
    reader = DatasetReader(world.data)
    return Geometry.from_arrays(reader.body, reader.cell_type)


def scaled(world: World) -> FastCertificate:
    """Bounds that know ratios of single components."""
    return replace(world.fast, ratios={**world.fast.ratios, "component": np.linspace(0, 3, 1001)})


def descent(world: World, given: Given) -> Descent:
    return world.model.body.descend(Load(given["force"]), given["displacement"], Aim(1e-6))[1]


def of_bayes(world: World) -> tuple[Array]:
    return (world.evaluation.predicted,)


def evaluated(world: World) -> surrogate.Evaluation:
    return surrogate.evaluate(world.run, world.dataset, passes=2)


@pytest.fixture(scope="module")
def worlds(
    make_run: Callable[..., Path], data: Path, tmp_path_factory: pytest.TempPathFactory
) -> tuple[World, World]:
    folder = tmp_path_factory.mktemp("aliasing")
    bayes = make_run(epochs=1, likelihood="variational_bayes", calibration_fraction=0.3)
    peaceful = World(bayes, data, folder / "peaceful", wild=False)
    return peaceful, World(bayes, data, folder / "wild", wild=True)


@pytest.fixture(autouse=True)
def _no_warnings() -> Iterator[None]:
    """Warnings of loads are of no interest here."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield


@pytest.mark.parametrize("name", CALLS)
def test_call(name: str, worlds: tuple[World, World]) -> None:
    require_no_aliases(CALLS[name], worlds, arguments)
