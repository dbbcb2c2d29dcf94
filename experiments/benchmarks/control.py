"""Soft robots that are led from markers, with a stiffness that their model does not know.

    python -m experiments benchmark control

makes the bodies of two cases, and the same on another mesh, in ``build/control``; the other one, of
finite elements and softer, is led by a `surrogate.Controller` of the first. It writes its record
and its page.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import surrogate
from experiments.benchmarks.benchmark import Results
from experiments.framework.factory import factory
from experiments.framework.machine import ROOT
from experiments.framework.report import table_of
from shared_schema.common import Parser
from surrogate.mechanics import Body
from surrogate.mechanics.actuation.actuated_body import ActuatedBody
from surrogate.mechanics.actuation.actuation import KEPT
from surrogate.mechanics.actuation.bordered import Balanced, balanced
from surrogate.mechanics.identification.markers import Markers
from surrogate.mechanics.statics.load import Load

Array = NDArray[np.float64]
STIFFNESS, NOISE = 0.8, 5e-4  # of the body over its model; of the size
FRAMES, LAP = 30, 100  # of a step and a payload, of a lap
SECONDS = 0.2  # from one limit of an actuator to the other
NEAR = 0.01  # of the size
BLIND = 1e6  # m: markers with such a noise tell nothing


@dataclass(frozen=True)
class Robot:
    """A case, how its script gives another mesh, and what it does.

    Attributes
    ----------
    script : str
        File of the mesh.
    changes : mapping of str to str
        Texts of the script, and what stands in their place for the other mesh.
    tip : tuple of 3 floats
        Place that is led, in m.
    payload : tuple of 3 floats
        Force on it in N.
    """

    case: str
    script: str
    changes: dict[str, str]
    tip: tuple[float, float, float]
    payload: tuple[float, float, float]


ROBOTS = (
    Robot("trunk3d", "trunk.geo", {"along = 40": "along = 24"}, (0, 0, 0.3), (0, 0.05, 0)),
    Robot(
        "actuator3d",
        "bending_actuator.geo",
        {
            "{2, 6, 2, 6, 2, 6, 2}": "{2, 5, 2, 5, 2, 5, 2}",
            "{2, 1, 4, 2}": "{2, 1, 3, 2}",
            "{2, 4, 2}": "{2, 5, 2}",
        },
        (0.1, 0.01, 0.009),
        (0, 0, 0.02),
    ),
)


class Plant:
    """Finite elements of the softer body, and a camera with noise.

    Parameters
    ----------
    body : Body
    tip : sequence of float
        Place that is led, in m.
    markers : array, (m, 3)
        Places at rest in m.
    seed : int
        Of the noise.
    """

    def __init__(self, body: Body, tip: Sequence[float], markers: Array, seed: int) -> None:
        self.body, self._markers = body, markers
        self._tip = np.array([tip], dtype=np.float64)
        self._at_tip = Markers.of(self._tip, self._tip).interpolation(body.geometry)
        self._at_markers = Markers.of(markers, markers).interpolation(body.geometry)
        assert body.geometry.actuators is not None
        self._actuators, none = body.geometry.actuators, np.zeros(body.equilibrium.free.shape)
        self._state = Balanced(none.ravel(), np.zeros(len(self._actuators)))
        self._force, self._random = none, np.random.default_rng(seed)
        self._noise = NOISE * float(np.ptp(body.geometry.coordinates, axis=0).max())

    def carry(self, force: Sequence[float]) -> None:
        """Let a force in N act on the tip from now on."""
        place = ",".join(f"{x:g}" for x in self._tip[0])
        text = f"{place}:{','.join(f'{f / STIFFNESS:g}' for f in force)}"
        load = Load.of(self.body.geometry, text, nearest=True)
        self._force = self.body.equilibrium.forces_at_points(load.dead[None])[0]

    def actuate(self, given: Array, stiffness: float = STIFFNESS) -> Array:
        """Find the equilibrium under actuations; where the tip is in m, (3,)."""
        of = ActuatedBody(self.body.equilibrium, self._actuators.loads, self._force)
        controls = self._actuators.controls(given / stiffness)
        self._state = balanced(of, controls, self._state, 1e-6)
        return np.asarray((self._tip + self._at_tip @ self._moved)[0])

    @property
    def seen(self) -> Array:
        """Where the markers are in m."""
        noise = self._random.normal(0, self._noise, self._markers.shape)
        return np.asarray(self._markers + self._at_markers @ self._moved + noise)

    @property
    def _moved(self) -> Array:
        nodes = len(self.body.geometry.coordinates)
        return self._state.state.reshape(self._force.shape)[:nodes]


@dataclass
class Led:
    """Frames of a controller on a plant."""

    controller: surrogate.Controller
    plant: Plant
    size: float
    missed: list[float] = field(default_factory=list)  # of the size
    seconds: list[float] = field(default_factory=list)  # of the processor
    stiffness: float = 1.0
    warnings: int = 0

    def to(self, targets: Array) -> list[float]:
        """Lead the tip through targets, (n, 3) in m: what it misses them by, of the size."""
        for target in targets:
            seen, began = self.plant.seen, time.process_time()
            frame = self.controller.step(seen, target)
            self.seconds.append(time.process_time() - began)
            tip = self.plant.actuate(np.array(list(frame.given.values())))
            self.missed.append(float(np.linalg.norm(tip - target)) / self.size)
            self.stiffness = frame.stiffness
            self.warnings += bool(frame.warning)
        return self.missed[-len(targets) :]


def path_of(case: str, plant: Plant, lap: int) -> Array:
    """Targets of a lap, (lap, 3) in m: a circle, or there and back where the tip has one way."""
    angles = 2 * np.pi * np.arange(1, lap + 1) / lap
    if case == "trunk3d":
        circle = [0.03 * np.cos(angles), 0.03 * np.sin(angles), np.full(lap, 0.29)]
        return np.stack(circle, axis=1)
    pressures = 8e3 + 4e3 * np.sin(angles)
    return np.array([plant.actuate(np.full(3, p), stiffness=1.0) for p in pressures])


def compare(robot: Robot, work: Path, options: argparse.Namespace) -> Results:
    """Lead one robot: step, lap, payload; and the same step without markers."""
    body, other = bodies(robot, work)
    modes = work / robot.case / KEPT
    if not modes.is_file():
        surrogate.Actuation.fit(body).save(modes)
    actuation, geometry = surrogate.Actuation.read(modes, body), body.geometry
    free = geometry.surface_nodes[geometry.free[geometry.surface_nodes].all(axis=1)]
    chosen = np.random.default_rng(options.seed).choice(free, options.markers, replace=False)
    markers, place = geometry.coordinates[chosen], ",".join(f"{x:g}" for x in robot.tip)
    limits = np.ptp([actuator.limits for actuator in actuation.actuators.actuators], axis=1)
    rates = dict(zip(actuation.names, (limits / SECONDS).tolist(), strict=True))

    def controller(noise: float | None = None) -> surrogate.Controller:
        return surrogate.Controller(
            actuation, markers=markers, target=place, rates=rates, noise=noise
        )

    plant = Plant(other, robot.tip, markers, options.seed)
    lap = path_of(robot.case, plant, options.lap)
    plant.actuate(np.zeros(len(limits)))
    blind = controller(noise=BLIND)
    for _ in range(options.frames):
        frame = blind.step(markers, lap[-1])
    tip = plant.actuate(np.array(list(frame.given.values())))
    without = float(np.linalg.norm(tip - lap[-1])) / actuation.size
    plant.actuate(np.zeros(len(limits)))
    led = Led(controller(), plant, actuation.size)
    step = led.to(np.repeat(lap[-1:], options.frames, axis=0))
    around = led.to(lap)
    stiffness = led.stiffness
    plant.carry(robot.payload)
    jump = plant.actuate(np.array(list(led.controller.given.values())))
    payload = led.to(np.repeat(lap[-1:], options.frames, axis=0))
    return {
        "case": robot.case,
        "nodes": len(geometry.coordinates),
        "nodes_of_plant": len(other.geometry.coordinates),
        "modes": len(actuation.reduced.modes),
        "without_markers": without,
        "step_frames": settled(step),
        "step_left": float(np.median(step[-10:])),
        "lap_largest": float(np.max(around)),
        "lap_mean": float(np.mean(around)),
        "stiffness": stiffness,
        "payload_moves": float(np.linalg.norm(jump - lap[-1])) / actuation.size,
        "payload_frames": settled(payload),
        "payload_left": float(np.median(payload[-10:])),
        "frame_ms": 1e3 * float(np.median(led.seconds)),
        "frame_95_ms": 1e3 * float(np.quantile(led.seconds, 0.95)),
        "warnings": led.warnings,
    }


def settled(missed: Sequence[float]) -> int:
    """Number of frames after which the tip stays near its target."""
    far = np.flatnonzero(np.array(missed) > NEAR)
    return int(far[-1]) + 1 if len(far) else 0


def bodies(robot: Robot, work: Path) -> tuple[Body, Body]:
    """Make the body of a case, and that on another mesh."""
    configs, found = ROOT / "datagen" / "configs", []
    for name, changes in ((robot.case, {}), (f"{robot.case}-plant", robot.changes)):
        folder = work / name
        if not folder.is_dir():
            scripts = work / f"{name}-script"
            scripts.mkdir(parents=True, exist_ok=True)
            text = (configs / robot.script).read_text()
            for before, after in changes.items():
                assert before in text, before
                text = text.replace(before, after)
            (scripts / robot.script).write_text(text)
            case = scripts / f"{robot.case}.yaml"
            case.write_text((configs / f"{robot.case}.yaml").read_text())
            factory("body", case, "--out", folder)
        found.append(Body.read(folder))
    return found[0], found[1]


def measure(options: argparse.Namespace) -> Results:
    """Lead all robots."""
    robots = [robot for robot in ROBOTS if robot.case in options.cases]
    return {
        "markers": options.markers,
        "stiffness": STIFFNESS,
        "lap": options.lap,
        "robots": [compare(robot, options.work, options) for robot in robots],
    }


def page(results: Results) -> str:
    """Make the page."""
    columns: dict[str, str] = {
        "case": "`{case}`",
        "nodes of model, body": "{nodes}, {nodes_of_plant}",
        "without markers": "{without_markers:.1%}",
        "step: frames to 1 %": "{step_frames}",
        "left": "{step_left:.2%}",
        "lap: mean": "{lap_mean:.2%}",
        "largest": "{lap_largest:.2%}",
        "stiffness found": "{stiffness:.2f}",
        "payload moves it by": "{payload_moves:.1%}",
        "frames to 1 %": "{payload_frames}",
        "left then": "{payload_left:.2%}",
        "frame [ms] (95 %)": "{frame_ms:.2g} ({frame_95_ms:.2g})",
    }
    rows: list[Any] = results["robots"]
    return table_of(rows, columns)


def arguments(parser: Parser) -> None:
    """Add the options."""
    names = [robot.case for robot in ROBOTS]
    parser.add_argument("--cases", nargs="+", default=names, choices=names)
    parser.add_argument("--markers", type=int, default=12)
    parser.add_argument("--frames", type=int, default=FRAMES, help="of a step and a payload")
    parser.add_argument("--lap", type=int, default=LAP, help="frames of a lap")
    parser.add_argument("--seed", type=int, default=401)
    parser.add_argument("--work", type=Path, default=Path("build/control"))


TITLE = "Soft robots that are led from markers"
ABOUT = (
    "`surrogate.Controller` leads the tip of a body of finite elements on another mesh, whose "
    "elastic modulus is {stiffness:g} of that of its model, at 100 frames a second. It sees "
    f"{{markers}} markers of the surface, with noise of {NOISE:.2%} of the length of the body, and "
    "is told neither the modulus nor the payload, a force on the tip. Actuators take "
    f"{SECONDS:g} s from one limit to the other at least. A *lap* of {{lap}} frames is a circle of "
    "30 mm radius for the tip of the trunk of 300 mm, for the other body one of its pressures "
    "from 4 to 12 kPa and back. "
    "Misses are distances of the true tip from its target over the length of the body. *Without "
    "markers*, the actuations of the step are those of the model alone. Times are those of the "
    "processor."
)
