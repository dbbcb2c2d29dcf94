"""WebSocket connections of clients, each with a session of its own (RFC 6455).

Messages are texts of at most `LARGEST` bytes; a larger one ends its connection, as the protocol
says. Requests of a client are answered one after the other, those of all in one worker thread, so
that no client waits for more than the others' present requests.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

from websockets.asyncio.server import Server, ServerConnection, serve
from websockets.exceptions import ConnectionClosed

from surrogate.inference.surrogate import Surrogate
from surrogate.serving.session import Session

logger = logging.getLogger(__name__)

__all__ = ["CLIENTS", "LARGEST", "Server", "serve_forever"]

LARGEST = 2**20  # bytes of a request
CLIENTS = 8  # at once
BUSY = 1013  # "try again later"


async def serve_forever(
    model: Surrogate, host: str, port: int, ready: Callable[[Server], None]
) -> None:
    """Serve a model until it is cancelled.

    Parameters
    ----------
    model : Surrogate
    host, port : str and int
        Where it listens; port 0 is any that is free.
    ready : callable
        Called with the server when it listens.

    Raises
    ------
    OSError
        If it cannot listen there.
    """
    clients: set[ServerConnection] = set()
    with ThreadPoolExecutor(1) as worker:

        async def attend(connection: ServerConnection) -> None:
            if len(clients) >= CLIENTS:
                await connection.close(BUSY, f"{CLIENTS} clients are connected")
                return
            clients.add(connection)
            session, loop = Session(model), asyncio.get_running_loop()
            try:
                async for message in connection:
                    reply = await loop.run_in_executor(worker, session.answer, message)
                    if '"error"' in reply[:200]:
                        logger.warning("%s: %s", connection.remote_address, reply[:200])
                    await connection.send(reply)
            except ConnectionClosed as closed:
                logger.warning("%s: %s", connection.remote_address, closed)
            finally:
                clients.discard(connection)

        async with serve(attend, host, port, max_size=LARGEST, compression=None) as server:
            ready(server)
            await server.serve_forever()
