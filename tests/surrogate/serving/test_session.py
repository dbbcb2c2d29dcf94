"""Requests of a client: what they do to a body, and what is refused."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest

import surrogate
from shared_schema.tools import Sphere
from surrogate.serving import Session


@pytest.fixture(scope="module")
def beam() -> surrogate.Surrogate:
    return surrogate.load("beam2d_any")


def ask(session: Session, **request: Any) -> dict[str, Any]:
    reply: dict[str, Any] = json.loads(session.answer(json.dumps(request)))
    return reply


def test_requests_are_those_of_python(beam: surrogate.Surrogate) -> None:
    session = Session(beam)
    mesh = ask(session, do="mesh", id=7)
    np.testing.assert_array_equal(mesh["coordinates"], beam.geometry.coordinates)
    assert (mesh["id"], mesh["case"], mesh["length"]) == (7, "beam2d_any", "m")
    loaded = ask(session, do="load", load=["4,1:0,-1.5"], body_force=[0, -0.1])
    solution = beam.solve("4,1:0,-1.5", body_force=(0, -0.1))
    np.testing.assert_allclose(loaded["displacement"], solution.displacement, atol=1e-7)
    touch = surrogate.Touch(beam)
    for y in (1.25, 1.2):
        pushed = ask(session, do="push", tool=f"sphere:3,{y}:0.3", nodes="surface")
        frame = touch.move(Sphere((3, y), 0.3))
        np.testing.assert_allclose(pushed["reaction"], frame.reaction)
        on_surface = frame.displacement[mesh["surface"]]
        np.testing.assert_allclose(pushed["displacement"], on_surface)
        assert pushed["touched"] == frame.nodes
    felt = ask(session, do="feel", tool="sphere:3,1.199:0.3")
    np.testing.assert_allclose(felt["reaction"], touch.reaction(Sphere((3, 1.199), 0.3)))
    held = ask(session, do="hold", held={"4,1": [None, -0.3], "4,0": [0, None]}, fields=False)
    grips = beam.solve(held={"4,1": (None, -0.3), "4,0": (0, None)}).grips
    assert grips is not None
    np.testing.assert_allclose(held["reactions"], grips, rtol=1e-3, atol=1e-6)
    assert "displacement" not in held
    assert not np.any(ask(session, do="let_go")["displacement"])


@pytest.mark.parametrize(
    ("request_", "said"),
    [
        ("{", "expected JSON"),
        (b"\xff\x00", "expected JSON"),
        ("[" * 100_000, "expected JSON"),
        ("[1]", "expected a JSON object"),
        ('{"do": "eat"}', "do: expected one of mesh"),
        ('{"do": ["mesh"]}', "do: expected one of mesh"),
        ('{"do": "mesh", "tool": "x"}', "mesh: unknown key 'tool'"),
        ('{"do": "push"}', "tool: expected a text"),
        ('{"do": "push", "tool": "cube:1"}', "expected one of sphere"),
        ('{"do": "push", "tool": "sphere:nan,1:0.3"}', "expected finite numbers"),
        ('{"do": "push", "tool": "sphere:0,1:0.3"}', "overlaps nodes that are held"),
        ('{"do": "feel", "tool": "sphere:3,1.2:0.3"}', "expected a push before"),
        ('{"do": "hold", "held": {}}', "held: expected an object of 1 to 64 places"),
        ('{"do": "hold", "held": {"4,1": [1]}}', "expected 2 numbers or null"),
        ('{"do": "hold", "held": {"4,1": [NaN, 0]}}', "expected 2 numbers or null"),
        ('{"do": "hold", "held": {"9,9": [0, 0]}}', "no node stands there"),
        ('{"do": "load", "load": "4,1:0,-1"}', "load: expected a list of texts"),
        ('{"do": "load", "body_force": [1]}', "expected 2 numbers"),
        ('{"do": "load", "body_force": ["1", 2]}', "body_force: expected a list of numbers"),
        ('{"do": "let_go", "nodes": "some"}', 'nodes: expected "all" or "surface"'),
    ],
)
def test_wrong_requests(beam: surrogate.Surrogate, request_: str | bytes, said: str) -> None:
    reply = json.loads(Session(beam).answer(request_))
    assert reply["kind"] == "input"
    assert said in reply["error"]


def test_failed_searches_and_bugs_are_replies(
    beam: surrogate.Surrogate, monkeypatch: pytest.MonkeyPatch
) -> None:
    session = Session(beam)
    assert ask(session, do="push", tool="sphere:2,0.5:0.3")["kind"] == "work"
    monkeypatch.setattr(session, "_model", None)
    assert ask(session, do="load", id="a")["kind"] == "bug"
    assert ask(session, do="load", id="a")["id"] == "a"
