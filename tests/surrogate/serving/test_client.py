"""Requests of a client: what they do to a body, and what is refused."""

from __future__ import annotations

import json
from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import surrogate
from shared_schema.tools import Sphere
from surrogate.runtime.time_limit import OutOfTimeError, TimeLimit
from surrogate.serving import Client
from tests.surrogate.mechanics.actuation.test_actuation import fitted
from tests.surrogate.mechanics.actuation.test_controller import Plant
from tests.surrogate.mechanics.statics.test_cables import pulled


@pytest.fixture(scope="module")
def beam() -> surrogate.Surrogate:
    return surrogate.load("beam2d_any")


def ask(session: Client, **request: Any) -> dict[str, Any]:
    reply: dict[str, Any] = json.loads(session.answer(json.dumps(request)))
    return reply


def test_requests_are_those_of_python(beam: surrogate.Surrogate) -> None:
    session = Client(beam)
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


def test_a_client_controls_a_body() -> None:
    """Replies are frames of a controller; null is a marker that is not seen."""
    plant = Plant(fitted(pulled("quad", "linear")))
    model: Any = SimpleNamespace(geometry=plant.model.body.geometry, actuation=plant.model)
    session, target = Client(model), plant.goal({"along": 9.0, "anchored": 3.0}).tolist()
    setting = {"markers": plant.at_rest.tolist(), "rates": {"along": 1e3, "anchored": 1e3}}
    given, aim = {"along": 0.0, "anchored": 0.0}, {plant.place: target}
    for frame in range(8):
        seen = plant.seen(given).tolist()
        seen[0] = None
        asked = setting if frame == 0 else {}
        reply = ask(session, do="control", measured=seen, target=aim, fields=False, **asked)
        given = reply["given"]
    assert plant.missed(given, np.array(target)) < 1e-3 * plant.model.size
    assert (reply["unseen"], reply["warning"], "displacement" in reply) == (1, "", False)
    blind = ask(session, do="control", measured=None, target=aim)
    assert blind["given"] == given
    assert "no marker is seen" in blind["warning"]
    refused: list[tuple[dict[str, Any], str]] = [
        ({"target": {"2,0": target}}, "expected those of the first request"),
        ({"target": aim, "measured": [[0, 0, 0]]}, "expected points of 2 numbers, or null"),
        ({"target": aim, "measured": [[0, 0]]}, "measured has shape"),
        ({"target": aim, "rates": {"up": 1}}, "markers: expected a list"),
        ({"measured": None}, "target: expected an object"),
    ]
    for wrong, said in refused:
        assert said in ask(session, do="control", **wrong)["error"]


def test_steps_are_those_of_python(beam: surrogate.Surrogate) -> None:
    client, session = Client(beam), surrogate.Session(beam, density=1.0)
    for y in (1.3, 1.28):
        first = {"density": 1.0} if y == 1.3 else {}
        given = {"seconds": 0.02, "tool": f"sphere:3,{y}:0.3", "load": ["4,1:0,-0.1"]}
        moved = ask(client, do="step", **given, **first)
        frame = session.step(0.02, "4,1:0,-0.1", tool=Sphere((3, y), 0.3))
        np.testing.assert_allclose(moved["displacement"], frame.displacement)
        np.testing.assert_allclose(moved["velocity"], frame.velocity)
        np.testing.assert_allclose(moved["reaction"], frame.reaction)
    assert "density" in ask(client, do="step", seconds=0.02, density=2.0)["error"]
    assert not np.any(ask(client, do="let_go")["displacement"])


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
        ('{"do": "hold", "held": {"4,1": [1e999, 0]}}', "expected 2 numbers or null"),
        ('{"do": "hold", "held": {"4,1": [NaN, 0]}}', "expected JSON"),
        ('{"do": "mesh", "id": NaN}', "expected JSON"),
        ('{"do": "mesh", "id": -Infinity}', "expected JSON"),
        ('{"do": "mesh", "id": 1e999}', "id: expected a number, or a text of at most 1000"),
        ('{"do": "mesh", "id": [[]]}', "id: expected a number, or a text of at most 1000"),
        (f'{{"do": "mesh", "id": {"[" * 900 + "]" * 900}}}', "id: expected a number"),
        (f'{{"do": "mesh", "id": "{"x" * 1001}"}}', "id: expected a number"),
        (f'{{"do": "mesh", "id": {"9" * 5000}}}', "expected JSON"),
        (json.dumps({"do": "load", "load": 65 * ["4,1:0,1"]}), "expected 64 texts at most, found"),
        (json.dumps({"do": "load", "body_force": 100_000 * [1]}), "--body-force '1,1,1"),
        ('{"do": "push", "tool": "mesh:/etc/hostname"}', "the meshes are none"),
        ('{"do": "push", "tool": "mesh:/no/such/file"}', "the meshes are none"),
        ('{"do": "load", "load": ["/etc/hostname"]}', "--load '/etc/hostname': expected"),
        ('{"do": "hold", "held": {"9,9": [0, 0]}}', "no node stands there"),
        ('{"do": "load", "load": "4,1:0,-1"}', "load: expected a list of texts"),
        ('{"do": "load", "body_force": [1]}', "expected 2 numbers"),
        ('{"do": "load", "body_force": ["1", 2]}', "body_force: expected a list of numbers"),
        (
            '{"do": "control", "target": {"4,1": [4, 1]}}',
            "the modes that 'surrogate actuate' keeps",
        ),
        ('{"do": "let_go", "nodes": "some"}', 'nodes: expected "all" or "surface"'),
    ],
)
def test_wrong_requests(beam: surrogate.Surrogate, request_: str | bytes, said: str) -> None:
    reply = json.loads(Client(beam).answer(request_))
    assert reply["kind"] == "input"
    assert said in reply["error"]
    assert len(reply["error"]) <= 1000


def test_failed_searches_and_bugs_are_replies(
    beam: surrogate.Surrogate, monkeypatch: pytest.MonkeyPatch
) -> None:
    session = Client(beam)
    assert ask(session, do="push", tool="sphere:2,0.5:0.3")["kind"] == "work"
    monkeypatch.setattr(session, "_model", None)
    assert ask(session, do="load", id="a")["kind"] == "bug"
    assert ask(session, do="load", id="a")["id"] == "a"


def test_work_beyond_its_time_ends(beam: surrogate.Surrogate) -> None:
    """No prediction begins after the limit; the body is at rest again, and goes on."""
    session = Client(beam, seconds=-1)
    for request in (
        {"do": "load", "load": ["4,1:0,-1.5"]},
        {"do": "push", "tool": "sphere:3,1.2:0.3"},
        {"do": "hold", "held": {"4,1": [None, -0.3]}},
    ):
        reply = ask(session, **request, id=1)
        assert reply == {
            "id": 1,
            "error": "took more than -1 s; the body is at rest again",
            "kind": "work",
        }
        assert "expected a push" in ask(session, do="feel", tool="sphere:3,1.2:0.3")["error"]
    assert not np.any(ask(session, do="let_go")["displacement"])
    stopped = Client(beam)
    stopped.stop()
    assert ask(stopped, do="load", load=["4,1:0,-1.5"])["kind"] == "work"
    assert "displacement" in ask(Client(beam), do="load", load=["4,1:0,-1.5"])


def test_contact_searches_end_as_well(beam: surrogate.Surrogate) -> None:
    """Newton's method with a tool asks for the time in every step, not only predictions."""
    touch, limit = surrogate.Touch(beam), TimeLimit(-1)
    with limit.running(), pytest.raises(OutOfTimeError):
        touch.correct(Sphere((3, 1.2), 0.3))
    assert touch.correct(Sphere((3, 1.2), 0.3)).reaction[1] == pytest.approx(-0.593, rel=0.05)


def test_sessions_in_threads_answer_as_one_alone(beam: surrogate.Surrogate) -> None:
    """Frames of four clients at the same time, bit by bit those of each alone."""

    def frames(number: int) -> list[str]:
        session, x = Client(beam), 2.6 + 0.2 * number
        tools = [f"sphere:{x},{y}:0.3" for y in (1.28, 1.25, 1.2)]
        said: list[dict[str, Any]] = [{"do": "push", "tool": tool} for tool in tools]
        held = {"4,1": [None, -0.1 * number], "4,0": [0, None]}
        said += [{"do": "load", "load": [f"4,1:0,{number}"]}, {"do": "hold", "held": held}]
        return [session.answer(json.dumps(each)) for each in said]

    alone = [frames(number) for number in range(4)]
    with ThreadPoolExecutor(4) as threads:
        assert list(threads.map(frames, range(4))) == alone
