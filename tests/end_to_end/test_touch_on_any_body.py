"""Grips, tools and markers on bodies of all elements and materials, with forces and pressures.

Both programs solve the same: contact is that of the nodes, and a grip of a group holds the points
between its nodes as well. Forces and pressures are found from what the factory makes of them. The
matrix (`tests.end_to_end.matrix`) has grips of nodes, tools and forces on all bodies.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import surrogate
from tests.end_to_end.halves import by_factory, case_of, series_of

BODIES = [
    ("gent", "linear", "pressure"),
    ("yeoh", "quadratic", "force"),
    ("mooney-rivlin", "incompressible", "pressure"),
]
LOADS = {"force": "4,1:0.5,-1.5", "pressure": "upper:1"}
PUSHED = "4,0:0.3,0.8"
ASKED: dict[str, tuple[list[str], dict[str, Any]]] = {
    "hold": (["--hold", "end:0,-0.1"], {"held": ["end:0,-0.1"]}),
    "tool": (["--tool", "sphere:3,-1.15:1"], {"tool": "sphere:3,-1.15:1"}),
}


@pytest.fixture(scope="module")
def bodies(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Folders of the bodies by their names, with what the factory finds."""
    folder, found = tmp_path_factory.mktemp("bodies"), {}
    commands: list[list[str | Path]] = []
    for kind in BODIES:
        case = case_of(folder, *kind)
        found["-".join(kind)] = place = folder / case.stem
        commands.append(["body", case, "--out", place])
        for what, (options, _) in ASKED.items():
            out = folder / f"{case.stem}-{what}.npz"
            commands.append(["solve", case, "--load", LOADS[kind[2]], *options, "--out", out])
        out = folder / f"{case.stem}.npz"
        commands.append(["solve", case, "--load", LOADS[kind[2]], "--load", PUSHED, "--out", out])
    by_factory(commands)
    return {name: series_of(body) for name, body in found.items()}


@pytest.mark.slow
@pytest.mark.parametrize("asked", ASKED)
@pytest.mark.parametrize("kind", BODIES, ids="-".join)
def test_touch_is_that_of_the_factory(
    bodies: dict[str, Path], kind: tuple[str, str, str], asked: str
) -> None:
    name = "-".join(kind)
    model, load = surrogate.load(bodies[name]), LOADS[kind[2]]
    with np.load(bodies[name].with_name(f"{name}-{asked}.npz")) as file:
        truth = dict(file)
    for correct, within in ((False, 1e-3), (True, 1e-8)):
        found = model.solve(load, **ASKED[asked][1], correct=correct)
        expected = {"displacement": found.displacement, "force": found.force}
        if "force_between" in truth:
            assert found.force_between is not None
            expected["force_between"] = found.force_between
        for field, values in expected.items():
            largest = np.abs(truth[field]).max()
            np.testing.assert_allclose(values, truth[field], atol=within * largest)


@pytest.mark.slow
@pytest.mark.parametrize("kind", BODIES, ids="-".join)
def test_what_has_moved_markers_is_found(
    bodies: dict[str, Path], kind: tuple[str, str, str]
) -> None:
    """A force, and another one or the pressure beside it, within four standard deviations."""
    name = "-".join(kind)
    model = surrogate.load(bodies[name])
    with np.load(bodies[name].with_name(f"{name}.npz")) as file:
        x, u = file["coordinates"], file["displacement"]
    nodes = model.geometry.surface_nodes[::2]
    noise = np.random.default_rng(0).normal(0, 2e-3, x[nodes].shape)
    markers = surrogate.Markers.of(x[nodes], x[nodes] + u[nodes] + noise)
    sought, truth = ["4,0", "4,1"], np.array([0.3, 0.8, 0.5, -1.5])
    if kind[2] == "pressure":
        sought, truth = ["4,0", "pressure:upper"], np.array([0.3, 0.8, 1.0])
    for confirm in (False, True):
        found = surrogate.identify(model, markers, sought, noise=2e-3, confirm=confirm)
        assert (np.abs(found.values - truth) < 4 * found.std).all()
        assert np.abs(found.displacement - u).max() < 5 * found.std_displacement.max()
        beside = surrogate.identify(model, markers, ["4,0"], [LOADS[kind[2]]], confirm=confirm)
        assert (np.abs(beside.values - truth[:2]) < 4 * beside.std).all()
