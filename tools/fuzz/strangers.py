"""A server among strangers: pages of other origins, other hosts, names of files, damaged messages.

The worker's process executes it as the command ``strangers RUN SEED``.
"""

from __future__ import annotations

import asyncio
import json
import sys
import warnings
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
from websockets.asyncio.client import connect
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.typing import Origin

import surrogate
from surrogate.serving.admission import Admission
from surrogate.serving.server import Server, serve_forever
from tools.fuzz.mutations import NASTY

STRANGERS = 40
PAGES = {  # by origin, whether it may connect
    "http://localhost:8000": True,
    "http://127.0.0.1": True,
    "https://example.org": False,
    "http://localhost.example.org": False,
    "http://example.org:8765": False,
    "null": False,
}
HOSTS = {"localhost": True, "127.0.0.1:80": True, "example.org": False, "rebound.example": False}
FILES = ("/etc/passwd", "/etc/no-such-file", "../manifest.json", "config.yaml", "/dev/zero")


def main(words: list[str]) -> int:
    """Serve a network; exit code 1 if a stranger gets in or a friend gets a wrong answer."""
    warnings.simplefilter("ignore")
    loop = asyncio.new_event_loop()  # which ends with the process
    found = loop.run_until_complete(visits(surrogate.load(words[1]), Random(words[2])))
    if found:
        print("; ".join(sorted(set(found))), file=sys.stderr)
    return 1 if found else 0


async def visits(model: surrogate.Surrogate, random: Random) -> list[str]:
    """Let strangers come, and a friend between them; say what was wrong."""
    server: asyncio.Future[Server] = asyncio.get_running_loop().create_future()
    options: dict[str, Any] = {"admission": Admission(), "meshes": {}, "seconds": 30.0}
    task = asyncio.create_task(serve_forever(model, "127.0.0.1", 0, server.set_result, **options))
    port = (await server).sockets[0].getsockname()[1]
    place = model.geometry.coordinates[np.flatnonzero(~model.geometry.clamped)[-1]]
    at = ",".join(map(repr, place.tolist()))
    request = json.dumps({"do": "load", "load": [f"{at}:{','.join(['0.1'] * len(place))}"]})
    found: list[str] = []
    async with connect(f"ws://127.0.0.1:{port}") as friend:
        await friend.send(request)
        right = await friend.recv()
        for _ in range(STRANGERS):
            found += await random.choice((pages, names, nonsense))(port, random)
            await friend.send(request)
            if await asyncio.wait_for(friend.recv(), 60) != right:
                found.append("a friend gets another answer")
    assert not task.done()
    return found


async def pages(port: int, random: Random) -> list[str]:
    """Connect as a page, or by a name: only those of this machine get in."""
    origin, host = random.choice(list(PAGES)), random.choice(list(HOSTS))
    expected = PAGES[origin] and HOSTS[host]
    try:
        async with connect(
            f"ws://{host}{'' if ':' in host else ':80'}/",
            host="127.0.0.1",
            port=port,
            origin=Origin(origin),
        ):
            entered = True
    except InvalidStatus:
        entered = False
    return [] if entered == expected else [f"{origin} by {host}: {'let in' if entered else 'not'}"]


async def names(port: int, random: Random) -> list[str]:
    """Name a file as a tool: the same refusal, whether or not it is there."""
    said = set()
    async with connect(f"ws://127.0.0.1:{port}") as stranger:
        for file in (*random.sample(FILES, 2), str(Path(__file__))):
            await stranger.send(json.dumps({"do": "push", "tool": f"mesh:{file}"}))
            reply = json.loads(await stranger.recv())
            said.add(reply.get("error", "no error").replace(file, ""))
    return [] if len(said) == 1 and "no error" not in said else [f"files are told apart: {said}"]


async def nonsense(port: int, random: Random) -> list[str]:
    """Send damaged requests: each has a reply with an error, or ends its own connection."""
    try:
        async with connect(f"ws://127.0.0.1:{port}") as stranger:
            for _ in range(random.randint(1, 5)):
                await stranger.send(damaged(random))
                reply = json.loads(await asyncio.wait_for(stranger.recv(), 60))
                if reply.get("kind") == "bug":
                    return ["a request fails with a traceback"]
    except ConnectionClosed as closed:
        return [] if closed.rcvd is not None else ["a connection ends without a word"]
    except TimeoutError:
        return ["a request has no reply"]
    return []


def damaged(random: Random) -> str | bytes:
    """A request with something wrong in it."""
    key = random.choice(("do", "id", "load", "tool", "held", "body_force", "fields", "nodes"))
    wrong = random.choice(("NaN", "Infinity", "1e999", "[" * 500 + "]" * 500, '"\\ud800"', "{}"))
    value = random.choice((wrong, *[json.dumps(text) for text in NASTY]))
    what = random.choice(("mesh", "load", "push", "feel", "hold", "let_go"))
    text = f'{{"do": "{what}", "{key}": {value}}}'
    if random.random() < 0.2:
        return random.randbytes(random.randrange(1, 200))
    return text[: random.randrange(len(text))] if random.random() < 0.2 else text
