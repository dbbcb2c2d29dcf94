"""Cables and chambers: unit forces against finite differences, closed forms, wrong cases."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from shared_schema.actuators import Control, PlacedActuators, actuators_of, placed_actuators
from shared_schema.common.bodies.command_loads import LoadedBody
from shared_schema.common.bodies.points_between import PointsBetween
from shared_schema.common.bodies.reference_cells import CORNERS
from shared_schema.common.errors import InputError

CABLE = {"cable": [{"fixed": [0, 0.5, -1]}, [0.5, 0.5, 0.4], [0.4, 2.2, 1.1], [2.6, 2.7, 2.9]]}
CASE = {"left": {**CABLE, "tension": [0, 5]}, "top": {"chamber": "hole", "pressure": [-1, 2]}}


def hollow(size: int = 3, quadratic: bool = False, dimension: int = 3) -> LoadedBody:
    """A block of size^d unit cells without the inner ones; the group `hole` bounds these."""
    grid = np.stack(np.meshgrid(*[np.arange(size + 1)] * dimension, indexing="ij"), -1)
    x = grid.reshape(-1, dimension).astype(np.float64)
    number = np.arange(len(x)).reshape(grid.shape[:-1])
    kind = {2: "quad", 3: "hexahedron"}[dimension]
    found = []
    for place in np.ndindex(*[size] * dimension):
        if not all(0 < p < size - 1 for p in place):
            found.append([number[tuple(np.add(place, c))] for c in CORNERS[kind]])
    cells = np.array(found, dtype=np.int64)
    hole = ((x > 0) & (x < size)).all(axis=1)
    points = PointsBetween.of(cells, kind, len(x)) if quadratic else None
    groups = {"hole": hole, "outer": ~hole, "side": x[:, 0] == 0}
    return LoadedBody(x, cells, kind, np.zeros(x.shape, dtype=bool), groups, points)


def placed(body: LoadedBody, content: dict[str, Any] = CASE) -> PlacedActuators:
    return placed_actuators(actuators_of(content), body)


def moved(body: LoadedBody, seed: int = 0) -> Any:
    x = body.positions
    return x + 0.1 * np.random.default_rng(seed).standard_normal(x.shape)


@pytest.mark.parametrize("quadratic", [False, True])
@pytest.mark.parametrize("name", ["left", "top"])
def test_forces_and_tangents_are_derivatives(name: str, quadratic: bool) -> None:
    body = hollow(quadratic=quadratic)
    load = dict(zip(placed(body).names, placed(body).loads, strict=True))[name]
    x, way = moved(body), moved(body, 1) - body.positions
    h = 1e-5
    ahead, back = load.quantity(x + h * way), load.quantity(x - h * way)
    forces = load.forces(x)
    assert load.sign * (forces * way).sum() == pytest.approx((ahead - back) / (2 * h), rel=1e-7)
    by_differences = (load.forces(x + h * way) - load.forces(x - h * way)) / (2 * h)
    change = np.zeros_like(x)
    for points, blocks in load.tangents(x):
        of_blocks = np.einsum("nij,nj->ni", blocks, way[points].reshape(len(points), -1))
        np.subtract.at(change, points, of_blocks.reshape(*points.shape, x.shape[1]))
    assert np.abs(change - by_differences).max() < 1e-8 * np.abs(change).max() + 1e-9


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("name", ["left", "top"])
def test_terms_are_those_of_the_taylor_series(name: str, dimension: int) -> None:
    """What four terms leave falls by 2⁴ = 16 with half the step."""
    body = hollow(dimension=dimension)
    cable = [{"fixed": [0, -1]}, [0.5, 0.5], [2.6, 2.7]] if dimension == 2 else CABLE["cable"]
    actuators = placed(body, {**CASE, "left": {"cable": cable, "tension": [0, 1]}})
    load = dict(zip(actuators.names, actuators.loads, strict=True))[name]
    x = [body.positions, *(moved(body, k) - body.positions for k in (1, 2, 3))]
    forces, quantities = load.terms(x)
    left = []
    for s in (0.02, 0.01):
        at = sum(s**k * term for k, term in enumerate(x))
        force = sum(s**k * term for k, term in enumerate(forces))
        quantity = sum(s**k * term for k, term in enumerate(quantities))
        left.append((np.abs(load.forces(at) - force).max(), load.quantity(at) - quantity))
    exact = name == "top" and dimension == 2  # forces are linear, and the area is quadratic
    for coarse, fine in zip(*left, strict=True):
        assert abs(coarse) < 1e-12 or coarse / fine == pytest.approx(16, rel=0.15)
    assert not exact or left[0][0] < 1e-12


def test_a_cable_without_fixed_points_has_no_resultant() -> None:
    body = hollow(quadratic=True)
    cable = {"cable": CABLE["cable"][1:], "length": [1, 2]}
    (load,) = placed(body, {"left": cable}).loads
    x = moved(body)
    force = load.forces(x)
    assert np.abs(force).max() > 0.1
    assert np.abs(force.sum(axis=0)).max() < 1e-14
    assert np.abs(np.cross(x, force).sum(axis=0)).max() < 1e-13


@pytest.mark.parametrize("quadratic", [False, True])
def test_length_and_volume_at_rest(quadratic: bool) -> None:
    """The hole of 5³ cells is 3³ m³; the cable is straight between its points."""
    ends = [[0.5, 0.5, 0.4], [4.5, 0.5, 0.4]]
    cable = {"cable": [{"fixed": [0, 0.5, -1]}, *ends], "tension": [0, 5]}
    actuators = placed(hollow(5, quadratic), {**CASE, "left": cable})
    points = np.array([[0, 0.5, -1], *ends])
    length = np.linalg.norm(np.diff(points, axis=0), axis=1).sum()
    assert actuators.names == ("left", "top")
    assert actuators.rest == pytest.approx([length, 27.0])


def test_laws_of_control() -> None:
    """Compressed to half the volume, a gas has twice the pressure; a slack cable does not pull."""
    gas = Control("gas", 0.0, rest=3.0, ambient=1e5)
    assert gas.equation(1.0, 1e5, 1.5).value == pytest.approx(0.0)
    blown = Control("gas", 1e4, rest=3.0, ambient=1e5)
    assert blown.equation(0.5, 5e3, 3.0).value == pytest.approx(0.0)  # half of it, at rest
    cable = Control("length", 0.9, rest=1.0)
    assert cable.equation(1.0, 2.0, 0.95).value == pytest.approx(0.05)
    assert cable.equation(1.0, 0.0, 0.8) == (0.0, 1.0, 0.0, 0.0)
    assert cable.target(0.5) == pytest.approx(0.95)
    fluid = Control("volume", 4.0, rest=2.0)
    assert fluid.equation(0.5, 7.0, 3.0) == (0.0, 0.0, 0.5, -0.25)
    assert Control("tension", 4.0, rest=2.0).equation(0.5, 3.0, 3.0).value == 1.0
    h = 1e-6
    value = blown.equation(1.0, 2e4, 2.0)
    assert value.by_amplitude == pytest.approx(
        (blown.equation(1.0, 2e4 + h, 2.0).value - value.value) / h, rel=1e-3
    )
    assert value.by_quantity == pytest.approx(
        (blown.equation(1.0, 2e4, 2.0 + h).value - value.value) / h, rel=1e-6
    )


def test_values_are_drawn_between_the_limits() -> None:
    actuators = placed(hollow())
    drawn = np.array([actuators.draw(number, seed=3) for number in range(200)])
    for column, (low, high) in zip(drawn.T, [(0, 5), (-1, 2)], strict=True):
        assert low <= column.min() < low + 0.1
        assert high - 0.1 < column.max() <= high
    assert np.array_equal(drawn[7], actuators.draw(7, seed=3))
    assert not np.array_equal(drawn[7], actuators.draw(7, seed=4))


def test_what_a_command_gives() -> None:
    actuators = placed(hollow())
    idle, given = actuators.idle, actuators.given(["top=1.5", "left.length=2"])
    assert [(each.kind, each.value) for each in idle] == [("tension", 0), ("pressure", 0)]
    assert all(each.rests for each in idle)
    assert [(each.kind, each.value) for each in given] == [("length", 2), ("pressure", 1.5)]
    for text, said in (
        ("right=1", "the actuators are left, top"),
        ("top", "expected NAME=VALUE"),
        ("top=nan", "expected a number"),
        ("left=-1", "expected a number from 0"),
        ("left.length=0", "expected a number above 0"),
        ("left.volume=1", "kind 'volume', expected tension, length"),
        ("top.gas=1", "no 'ambient'"),
    ):
        with pytest.raises(InputError, match=said):
            actuators.given([text])


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ({"a": {"cable": [[0, 0, 0], [9, 9, 9]], "tension": [0, 1]}}, r"a.cable.1'.*outside"),
        ({"a": {"cable": [[0, 0, 0], [0, 0, 0]], "tension": [0, 1]}}, "the point before it"),
        ({"a": {"cable": [[0, 0], [1, 1]], "tension": [0, 1]}}, "2 numbers, expected 3"),
        ({"a": {"cable": [{"fixed": [0, 0, 0]}] * 2, "tension": [0, 1]}}, "the point before it"),
        ({"a": {"chamber": "side", "pressure": [0, 1]}}, "leave an edge open"),
        ({"a": {"chamber": "outer", "pressure": [0, 1]}}, "the outside of the body"),
        ({"a": {"chamber": "hall", "pressure": [0, 1]}}, "no such group.*hole"),
    ],
)
def test_actuators_that_do_not_fit_the_body(content: dict[str, Any], said: str) -> None:
    with pytest.raises(InputError, match=said):
        placed(hollow(), content)


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ({"chamber": "hole", "pressure": [2, 1]}, "low < high"),
        ({"chamber": "hole", "volume": [0, 1]}, "above 0"),
        ({"chamber": "hole", "gas": [0, 1]}, "ambient"),
        ({"chamber": "hole", "gas": [-2, 1], "ambient": 1}, "no gas at all"),
        ({"chamber": "hole"}, "expected one of pressure, volume, gas"),
        ({"chamber": "hole", "pressure": [0, 1], "volume": [1, 2]}, "expected one of"),
        ({"cable": [[0, 0, 0], [1, 1, 1]], "tension": [-1, 1]}, "cannot push"),
        ({"cable": [[0, 0, 0], [1, 1, 1]], "pull": [0, 1]}, "key 'actuators.a.pull'|a.pull"),
        ({"cable": [[0, 0, 0]], "tension": [0, 1]}, "a.cable"),
        ({"pressure": [0, 1]}, "'cable' or 'chamber'"),
    ],
)
def test_actuators_that_no_case_has(content: dict[str, Any], said: str) -> None:
    with pytest.raises(ValueError, match=said):
        actuators_of({"a": content})
    with pytest.raises(ValueError, match="expected a name"):
        actuators_of({"a.b": CASE["left"]})


@pytest.mark.parametrize("dimension", [2, 3])
def test_walls_that_pass_through_each_other(dimension: int) -> None:
    """The lower wall of the hole of 1 m is moved up by 0.9 m, then by 1.1 m."""
    body = hollow(dimension=dimension)
    actuators = placed(body, {"top": CASE["top"]})
    x = body.positions.copy()
    below = body.groups["hole"] & (x[:, -1] == 1)
    x[below, -1] += 0.9
    assert actuators.wall_problem(x) is None
    x[below, -1] += 0.2
    assert "the chamber 'top' pass through" in str(actuators.wall_problem(x))
