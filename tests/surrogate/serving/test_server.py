"""The server: clients of their own state, refused messages, random bytes."""

from __future__ import annotations

import asyncio
import json
import queue
import random
import re
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from surrogate.learning.inference.loading import load
from surrogate.learning.inference.surrogate import Surrogate
from surrogate.mechanics.statics.load import given_load
from surrogate.runtime.time_limit import require_time
from surrogate.serving.admission import Admission
from surrogate.serving.server import (
    CLIENTS,
    FRAGMENTS,
    LARGEST,
    WAITING,
    Server,
    serve_forever,
)

SURROGATE = Path(sys.executable).with_name("surrogate")
HANDSHAKE = (  # with the key of RFC 6455
    "GET / HTTP/1.1\r\nHost: {host}\r\n{origin}Upgrade: websocket\r\nConnection: Upgrade\r\n"
    "Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n"
)


@pytest.fixture(scope="module")
def server() -> Iterator[tuple[str, subprocess.Popen[str]]]:
    """The address of a server, and its process."""
    command = [str(SURROGATE), "serve", "beam2d_any", "--port", "0", "--seconds", "3600"]
    command += ["--origin", "https://viewer.example.org"]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.DEVNULL, "text": True}
    with subprocess.Popen(command, **pipes) as process:  # type: ignore[call-overload]
        line = process.stdout.readline()
        found = re.search(r"ws://127\.0\.0\.1:\d+", line)
        assert found is not None
        yield found.group(), process
        process.terminate()


def memory(process: subprocess.Popen[str]) -> int:
    """Resident memory of a process in kB."""
    status = Path(f"/proc/{process.pid}/status").read_text()
    return int(re.findall(r"VmRSS:\s+(\d+) kB", status)[0])


def test_clients_have_their_own_state(server: tuple[str, subprocess.Popen[str]]) -> None:
    push = json.dumps({"do": "push", "tool": "sphere:3,1.2:0.3", "fields": False})
    feel = json.dumps({"do": "feel", "tool": "sphere:3,1.199:0.3"})
    with connect(server[0]) as first, connect(server[0]) as second:
        first.send(push)
        assert json.loads(first.recv())["reaction"][1] == pytest.approx(-0.595, rel=1e-2)
        second.send(feel)
        assert "expected a push before" in json.loads(second.recv())["error"]
        first.send(feel)
        assert json.loads(first.recv())["reaction"][1] < -0.595


def test_too_large_messages_and_too_many_clients(
    server: tuple[str, subprocess.Popen[str]],
) -> None:
    with connect(server[0]) as client:
        client.send("x" * (LARGEST + 1))
        with pytest.raises(ConnectionClosed, match="1009"):
            client.recv()
    with ExitStack() as clients:
        for _ in range(CLIENTS):
            client = clients.enter_context(connect(server[0]))
            client.send('{"do": "let_go"}')
            client.recv()
        with connect(server[0]) as one_more, pytest.raises(ConnectionClosed, match="1013"):
            one_more.recv()
    with connect(server[0]) as client:
        client.send('{"do": "let_go"}')
        assert "displacement" in json.loads(client.recv())


def test_random_bytes(server: tuple[str, subprocess.Popen[str]]) -> None:
    """Texts, bytes and damaged requests: a reply to each, and no growth."""
    rng, whole = random.Random(0), b'{"do": "push", "tool": "sphere:3,1.2:0.3", "fields": false}'
    sizes = []
    for number in range(4):
        with connect(server[0]) as client:
            for _ in range(200):
                damaged = bytearray(whole)
                for _ in range(rng.randrange(1, 4)):
                    damaged[rng.randrange(len(damaged))] = rng.randrange(256)
                wild = rng.randbytes(rng.randrange(300))
                message: str | bytes = bytes(damaged)
                if number % 2:
                    message = wild.decode("latin-1") if rng.random() < 0.5 else wild
                client.send(message)
                assert isinstance(json.loads(client.recv()), dict)
        if number:
            sizes.append(memory(server[1]))
    assert sizes[-1] < 1.05 * sizes[0]
    assert server[1].poll() is None


def opened(address: str) -> socket.socket:
    """A connection to a server that has said nothing yet."""
    host, port = address.removeprefix("ws://").split(":")
    return socket.create_connection((host, int(port)))


@pytest.mark.parametrize(
    ("host", "origin", "status"),
    [
        ("localhost:8765", "", 101),
        ("localhost:8765", "Origin: http://localhost:3000\r\n", 101),
        ("localhost:8765", "Origin: https://viewer.example.org\r\n", 101),
        ("localhost:8765", "Origin: https://example.org\r\n", 403),
        ("localhost:8765", "Origin: null\r\n", 403),
        ("example.org:8765", "", 403),
        ("example.org:8765", "Origin: http://example.org:8765\r\n", 403),  # a name bound anew
    ],
)
def test_pages_from_elsewhere_do_not_connect(
    server: tuple[str, subprocess.Popen[str]], host: str, origin: str, status: int
) -> None:
    with opened(server[0]) as connection:
        connection.sendall(HANDSHAKE.format(host=host, origin=origin).encode())
        assert connection.recv(12) == f"HTTP/1.1 {status}".encode()


def test_messages_in_very_many_parts(server: tuple[str, subprocess.Popen[str]]) -> None:
    """Empty parts, of which no sum of bytes would ever be too large."""
    with connect(server[0]) as client:
        client.send(['{"do": ', '"let_go"', "", "}"])
        assert "displacement" in json.loads(client.recv())
        client.send([""] * (FRAGMENTS - 1))
        assert json.loads(client.recv())["error"] == "expected JSON"
        with suppress(ConnectionClosed):
            client.send([""] * (FRAGMENTS + 9))
        with pytest.raises(ConnectionClosed, match="1009"):
            client.recv()


def test_connections_that_say_nothing_make_way(
    server: tuple[str, subprocess.Popen[str]],
) -> None:
    """Of 500 of them, the server keeps a part open, and lets a client in."""

    def files() -> int:
        return len(list(Path(f"/proc/{server[1].pid}/fd").iterdir()))

    before = files()
    with ExitStack() as silent:
        for _ in range(500):
            silent.enter_context(opened(server[0]))
        with connect(server[0]) as client:
            client.send('{"do": "let_go"}')
            assert "displacement" in json.loads(client.recv())
            assert files() <= before + WAITING + 2


def test_a_client_that_does_not_read_is_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of 25 MB of replies to pings, 1 MiB is kept, and what the system's own buffers take."""
    monkeypatch.setattr("surrogate.serving.server.UNREAD", 2**20)
    ping = bytes([0x89, 0x80 | 125]) + bytes(4) + 125 * b"x"
    with served(load("beam2d_any"), 3600) as address, opened(address) as connection:
        connection.sendall(HANDSHAKE.format(host="localhost", origin="").encode())
        assert connection.recv(12) == b"HTTP/1.1 101"
        with pytest.raises(ConnectionError):
            connection.sendall(200_000 * ping)


class Held:
    """A body whose predictions under a load do not end before they are let go.

    Attributes
    ----------
    begun, freed, ended : Event
        Such a prediction has begun, may end, has ended.
    """

    def __init__(self, beam: Surrogate) -> None:
        self._beam, self.geometry = beam, beam.geometry
        self.begun, self.freed, self.ended = (threading.Event() for _ in range(3))

    def predict(self, forces: np.ndarray) -> np.ndarray:
        """Displacements in m under nodal forces in N."""
        if forces.any():
            self.begun.set()
            try:
                while not self.freed.is_set():
                    require_time()
            finally:
                self.ended.set()
        return self._beam.predict(forces)


@contextmanager
def served(model: Any, seconds: float) -> Iterator[str]:
    """The address of a server in another thread."""
    found: queue.Queue[str] = queue.Queue()

    def ready(server: Server) -> None:
        (listening,) = server.sockets
        found.put(f"ws://127.0.0.1:{listening.getsockname()[1]}")

    options: dict[str, Any] = {"admission": Admission(), "meshes": {}, "seconds": seconds}
    loop = asyncio.new_event_loop()
    task = loop.create_task(serve_forever(model, "127.0.0.1", 0, ready, **options))

    def run() -> None:
        with suppress(asyncio.CancelledError):
            loop.run_until_complete(task)

    thread = threading.Thread(target=run)
    thread.start()
    try:
        yield found.get()
    finally:
        loop.call_soon_threadsafe(task.cancel)
        thread.join()
        loop.close()


LONG, SHORT = '{"do": "load", "load": ["4,1:0,-1"]}', '{"do": "load", "id": "short"}'


def test_the_work_of_one_client_does_not_stop_another() -> None:
    beam = load("beam2d_any")
    held = Held(beam)
    with served(held, 3600) as address, connect(address) as one, connect(address) as other:
        one.send(LONG)
        assert held.begun.wait(60)
        other.send(SHORT)
        assert json.loads(other.recv())["id"] == "short"
        assert not held.ended.is_set()
        held.freed.set()
        found = json.loads(one.recv())["displacement"]
    force = given_load(beam.geometry, "4,1:0,-1").forces
    np.testing.assert_allclose(found, beam.predict(force), rtol=1e-6)


def test_a_request_ends_when_its_time_is_over_or_its_client_has_gone() -> None:
    held = Held(load("beam2d_any"))
    with served(held, 0.01) as address, connect(address) as client:
        client.send(LONG)
        reply = json.loads(client.recv())
        assert (reply["kind"], reply["error"][:21]) == ("work", "took more than 0.01 s")
        client.send('{"do": "let_go"}')
        assert "displacement" in json.loads(client.recv())
    held = Held(load("beam2d_any"))
    with served(held, 3600) as address:
        with connect(address) as client:
            client.send(LONG)
            assert held.begun.wait(60)
            assert not held.ended.is_set()
        assert held.ended.wait(60)
