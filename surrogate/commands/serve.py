"""surrogate serve: let other programs push, hold and load a body."""

from __future__ import annotations

import argparse

from shared_schema.common.command_line import Commands, add_command
from surrogate.command_options import add_device, add_run


def add_to(commands: Commands) -> None:
    """Add the command's parser."""
    parser = add_command(
        commands,
        "serve",
        "let other programs push, hold and load a body, by WebSocket",
        "surrogate serve beam3d_any_reduced --port 8765",
    )
    add_run(parser)
    where = "address that it listens at (default 127.0.0.1: this machine alone)"
    parser.add_argument("--host", default="127.0.0.1", metavar="HOST", help=where)
    parser.add_argument("--port", type=_port, default=8765, metavar="PORT", help="(default 8765)")
    add_device(parser)
    parser.set_defaults(command=run)


def run(options: argparse.Namespace) -> None:
    """Serve until the program is stopped."""
    import asyncio

    import surrogate
    from shared_schema.common.errors import InputError, WorkError

    try:
        from surrogate.serving.server import Server, serve_forever
    except ImportError:
        raise InputError("serve: expected websockets: pip install surrogate[serve]") from None

    def ready(server: Server) -> None:
        for socket in server.sockets:
            host, port = socket.getsockname()[:2]
            print(f"{options.run} at ws://{host}:{port}; stop by Ctrl-C", flush=True)

    model = surrogate.load(options.run, options.device)
    try:
        asyncio.run(serve_forever(model, options.host, options.port, ready))
    except OSError as error:
        raise WorkError(f"--host {options.host} --port {options.port}: {error}") from None


def _port(text: str) -> int:
    """A port; 0 is any that is free."""
    try:
        port = int(text)
    except ValueError:
        port = -1
    if not 0 <= port < 2**16:
        raise argparse.ArgumentTypeError(f"'{text}': expected a number from 0 to 65535")
    return port
