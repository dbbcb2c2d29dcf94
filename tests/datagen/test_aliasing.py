"""No public call writes to what it is given, or reads again what it has returned."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import datagen
from shared_schema.tools import Sphere
from tests.aliasing import public_functions, public_names, require_no_aliases

Given = dict[str, Any]


class World:
    """What the calls are made on."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        folder.mkdir()

    def out(self, name: str) -> Path:
        """A folder that is not there."""
        shutil.rmtree(self.folder / name, ignore_errors=True)
        return self.folder / name

    @cached_property
    def case(self) -> datagen.Case:
        return datagen.read_case("beam2d")

    @cached_property
    def solution(self) -> datagen.Solution:
        return datagen.solve(self.case, "4,1:0,-0.5", stresses=True)

    @cached_property
    def motion(self) -> datagen.MovedBody:
        return moved("beam2d", np.zeros((64, 2)))

    @cached_property
    def nodal(self) -> Path:
        datagen.run("beam2d", self.folder / "nodal", samples=2)
        return self.folder / "nodal"


def moved(case: Any, force: Any) -> datagen.MovedBody:
    """Two steps of the beam."""
    return datagen.move(case, force, duration=0.1, step=0.05, changes=["material.density=1"])


def arguments() -> Given:
    """Arrays, lists and mappings that a caller may give."""
    force = np.zeros((64, 2))
    force[1] = 0.1, -0.5  # at 4, 0
    return {
        "force": force,
        "start": 0.01 * force,
        "body force": np.array([0.0, -0.1]),
        "held": ["4,1:0.02,-"],
        "loads": ["4,1:0,-0.5"],
        "centre": np.array([3.0, 1.25]),
        "way": np.array([[0.0, 0.2]]),
        "changes": ["material.young_modulus=400"],
        "content": datagen.read_case("beam2d").plain(),
        "samples": [1, 0],
    }


def tool(given: Given) -> Sphere:
    """A sphere that pushes the beam from above."""
    x, y = given["centre"]
    return Sphere((x, y), 0.3)


CALLS: dict[str, Callable[[World, Given], Any]] = {
    "solve": lambda w, g: [
        datagen.solve(w.case, g["force"], body_force=g["body force"], stresses=True),
        datagen.solve(w.case, g["force"], start=g["start"]),
        datagen.solve(g["content"], g["loads"], changes=g["changes"]),
    ],
    "solve, held": lambda w, g: datagen.solve(w.case, g["force"], held=g["held"]),
    "solve, tool": lambda w, g: datagen.solve(
        w.case, g["force"], tool=tool(g), tool_from=g["way"], friction=0.1
    ),
    "Solution.largest_displacement": lambda w, g: w.solution.largest_displacement,
    "Solution.plot": lambda w, g: w.solution.plot(),
    "Solution.save": lambda w, g: w.solution.save(w.folder / "u.npz"),
    "move": lambda w, g: moved(g["content"], g["force"]).trajectory,
    "MovedBody.largest_displacement": lambda w, g: w.motion.largest_displacement,
    "MovedBody.save": lambda w, g: w.motion.save(w.folder / "moved.npz"),
    "read_case": lambda w, g: datagen.read_case(g["content"], changes=g["changes"]).plain(),
    "Case.digest": lambda w, g: w.case.digest(),
    "Case.loads": lambda w, g: w.case.loads,
    "Case.materials": lambda w, g: w.case.materials,
    "Case.plain": lambda w, g: w.case.plain(),
    "run": lambda w, g: (
        datagen.run(g["content"], w.out("run"), samples=2, changes=g["changes"]).case
    ),
    "body": lambda w, g: datagen.body(g["content"], w.out("body"), changes=g["changes"]).case,
    "structure": lambda w, g: datagen.structure(w.nodal, w.out("grid"), grid="nodes").case,
    "add_noise": lambda w, g: datagen.add_noise(w.nodal, w.out("noisy"), seed=1).case,
    "export": lambda w, g: datagen.export(w.nodal, w.folder / "all.xdmf"),
    "plot": lambda w, g: datagen.plot(w.nodal, w.folder / "all.png", samples=g["samples"]),
    "info": lambda w, g: {**datagen.info(w.nodal), "folder": ""}.keys(),
    "check": lambda w, g: datagen.check(w.nodal),
    "case_keys": lambda w, g: datagen.case_keys(),
    "case_schema": lambda w, g: datagen.case_schema(),
    "shipped_cases": lambda w, g: datagen.shipped_cases(),
}
NO_ARRAYS = {"export_plaid", "publish", "repair"}  # given paths and texts, of files alone


@pytest.fixture(scope="module")
def worlds(tmp_path_factory: pytest.TempPathFactory) -> tuple[World, World]:
    folder = tmp_path_factory.mktemp("aliasing")
    return World(folder / "peaceful"), World(folder / "wild")


def test_every_public_name_is_called() -> None:
    classes = [getattr(datagen, name) for name in datagen.__all__]
    public = public_names([kind for kind in classes if isinstance(kind, type)], ("datagen",))
    called = {name.partition(",")[0] for name in CALLS}
    assert public | public_functions(datagen) == called | NO_ARRAYS


@pytest.mark.parametrize("name", CALLS)
def test_call(name: str, worlds: tuple[World, World]) -> None:
    require_no_aliases(CALLS[name], worlds, arguments)
