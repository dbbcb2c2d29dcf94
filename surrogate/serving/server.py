"""WebSocket connections of clients, each with a state and a thread of its own (RFC 6455).

Messages are texts of at most `LARGEST` bytes in at most `FRAGMENTS` parts; others end their
connection. Requests of a client are answered one after the other, those of several clients at the
same time. A request ends when its time is over, or its client has gone. What a client does not read
is kept for it up to `UNREAD` bytes. Of connections that have not said who they are, only the last
`WAITING` stay.
"""

from __future__ import annotations

import asyncio
import logging
import traceback
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Any

from websockets.asyncio.server import Server, ServerConnection, serve
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response

from shared_schema.tools import Mesh
from surrogate.learning.inference.surrogate import Surrogate
from surrogate.serving.admission import Admission
from surrogate.serving.client import Client

logger = logging.getLogger(__name__)
of_strangers = logging.getLogger(f"{__name__}.strangers")  # what they send is no news
of_strangers.setLevel(logging.CRITICAL + 1)

__all__ = ["CLIENTS", "FRAGMENTS", "LARGEST", "WAITING", "Server", "serve_forever"]

LARGEST = 2**20  # bytes of a request
FRAGMENTS = 2**10  # of a request
QUEUED = 4  # parts of requests that wait
UNREAD = 2**26  # bytes of replies
CLIENTS = 8  # at once
WAITING = 256  # connections that are not clients yet
HANDSHAKE, CLOSING = 5.0, 1.0  # s
BUSY, TOO_BIG = 1013, 1009  # codes: "try again later", "message too big"


async def serve_forever(
    model: Surrogate,
    host: str,
    port: int,
    ready: Callable[[Server], None],
    *,
    admission: Admission,
    meshes: Mapping[str, Mesh],
    seconds: float,
) -> None:
    """Serve a model until it is cancelled.

    Parameters
    ----------
    model : Surrogate
    host, port : str and int
        Where it listens; port 0 is any that is free.
    ready : callable
        Called with the server when it listens.
    admission : Admission
        Who may connect.
    meshes : mapping of str to Mesh
        Tools that clients may name.
    seconds : float
        That a request may take.

    Raises
    ------
    OSError
        If it cannot listen there.
    """
    clients: set[ServerConnection] = set()
    waiting: dict[Visitor, None] = {}  # in the order in which they came

    def refused(connection: ServerConnection, request: Request) -> Response | None:
        hosts, origins = (request.headers.get_all(name) for name in ("Host", "Origin"))
        said = admission.refusal(hosts, origins, str(connection.local_address[0]))
        return None if said is None else connection.respond(403, said + "\n")

    with ThreadPoolExecutor(CLIENTS) as threads:

        async def attend(connection: ServerConnection) -> None:
            assert isinstance(connection, Visitor)
            connection.is_known()
            if len(clients) >= CLIENTS:
                await connection.close(BUSY, f"{CLIENTS} clients are connected")
                return
            clients.add(connection)
            client = Client(model, meshes, seconds)
            gone = asyncio.ensure_future(connection.wait_closed())
            gone.add_done_callback(lambda _: client.stop())
            try:
                await converse(connection, client, threads)
            except ConnectionClosed:
                pass
            except Exception:
                logger.error("a connection failed: %s", traceback.format_exc())
            finally:
                clients.discard(connection)

        limits: dict[str, Any] = {"max_size": LARGEST, "max_queue": QUEUED, "compression": None}
        async with serve(
            attend,
            host,
            port,
            process_request=refused,
            create_connection=partial(Visitor, waiting),  # type: ignore[arg-type]  # makes a subclass
            open_timeout=HANDSHAKE,
            close_timeout=CLOSING,
            logger=of_strangers,
            server_header=None,
            **limits,
        ) as server:
            ready(server)
            await server.serve_forever()


async def converse(
    connection: ServerConnection, client: Client, threads: ThreadPoolExecutor
) -> None:
    """Answer the requests of a client until it goes, or ConnectionClosed says that it has gone."""
    loop = asyncio.get_running_loop()
    while True:
        request = await received(connection)
        if request is None:
            await connection.close(TOO_BIG, f"expected {FRAGMENTS} fragments at most")
            return
        await connection.send(await loop.run_in_executor(threads, client.answer, request))


async def received(connection: ServerConnection) -> str | bytes | None:
    """The next message; None if it has too many fragments."""
    parts: list[Any] = []
    async for part in connection.recv_streaming():
        parts.append(part)
        if len(parts) > FRAGMENTS:
            return None
    whole: str | bytes = type(parts[0])().join(parts)
    return whole


class Visitor(ServerConnection):
    """A connection, which may become that of a client.

    Parameters
    ----------
    waiting : dict
        Connections that are not yet known to be clients. The first one gives way to this one, if
        there are too many.
    """

    def __init__(self, waiting: dict[Visitor, None], *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self._waiting = waiting

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Join those that wait."""
        super().connection_made(transport)
        self._waiting[self] = None
        if len(self._waiting) > WAITING:
            first = next(iter(self._waiting))
            first.is_known()
            first.transport.abort()

    def connection_lost(self, exc: Exception | None) -> None:
        """Leave."""
        self.is_known()
        super().connection_lost(exc)

    def is_known(self) -> None:
        """Wait no longer."""
        self._waiting.pop(self, None)

    def data_received(self, data: bytes) -> None:
        """Receive data, unless the other side does not read what it gets for that."""
        super().data_received(data)
        if self.transport.get_write_buffer_size() > UNREAD:
            self.transport.abort()
