"""The server: clients of their own state, refused messages, random bytes."""

from __future__ import annotations

import json
import random
import re
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from surrogate.serving.server import CLIENTS, LARGEST

SURROGATE = Path(sys.executable).with_name("surrogate")


@pytest.fixture(scope="module")
def server() -> Iterator[tuple[str, subprocess.Popen[str]]]:
    """The address of a server, and its process."""
    command = [str(SURROGATE), "serve", "beam2d_any", "--port", "0"]
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
