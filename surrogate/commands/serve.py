"""surrogate serve: let other programs push, hold and load a body."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from shared_schema.common.command_line import Commands, add_command, add_parameter
from surrogate.command_options import add_device, add_run, positive

if TYPE_CHECKING:
    from shared_schema.tools import Mesh

SECONDS = 60.0  # of a request


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
    parser.add_argument(
        "--name",
        action="append",
        default=[],
        metavar="HOST",
        help="name by which other machines reach this one, beside the address; repeatable",
    )
    parser.add_argument(
        "--origin",
        action="append",
        default=[],
        metavar="ORIGIN",
        help="origin of web pages that may connect, such as https://example.org, beside servers on "
        "this machine; null for pages that are files, and for any page that hides its origin; "
        "repeatable",
    )
    parser.add_argument(
        "--mesh",
        type=Path,
        action="append",
        default=[],
        metavar="FILE[:SCALE]",
        help="closed surface that clients may push with, as mesh:NAME with its file's name, and "
        "the length of its unit in m; repeatable",
    )
    parser.add_argument(
        "--seconds",
        type=positive,
        default=SECONDS,
        metavar="S",
        help=f"that a request may take (default {SECONDS:g})",
    )
    add_parameter(parser)
    add_device(parser)
    parser.set_defaults(command=run)


def run(options: argparse.Namespace) -> None:
    """Serve until the program is stopped."""
    import asyncio

    import surrogate
    from shared_schema.common.errors import InputError, WorkError
    from surrogate.serving.admission import Admission
    from surrogate.serving.client import make_first_frame

    try:
        from surrogate.serving.server import Server, serve_forever
    except ImportError:
        said = "serve: expected websockets: pip install 'solid-surrogate[serve]'"
        raise InputError(said) from None

    def ready(server: Server) -> None:
        for socket in server.sockets:
            host, port = socket.getsockname()[:2]
            print(f"{options.run} at ws://{host}:{port}; stop by Ctrl-C", flush=True)

    admission = Admission.of(options.name, options.origin)
    meshes = read_meshes(options.mesh)
    model = surrogate.load(options.run, options.device)
    model = model.of_shape(options.parameters) if options.parameters else model
    make_first_frame(model)
    serving = serve_forever(
        model,
        options.host,
        options.port,
        ready,
        admission=admission,
        meshes=meshes,
        seconds=options.seconds,
    )
    try:
        asyncio.run(serving)
    except OSError as error:
        raise WorkError(f"--host {options.host} --port {options.port}: {error}") from None


def read_meshes(paths: list[Path]) -> dict[str, Mesh]:
    """Read the surfaces of FILE[:SCALE], by the names of their files.

    Raises
    ------
    InputError
        If one is none, or two have one name.
    """
    from shared_schema.common.errors import InputError
    from shared_schema.tools import Mesh

    meshes: dict[str, Mesh] = {}
    for path in paths:
        file, _, scale = str(path).partition(":")
        name = Path(file).name
        if name in meshes:
            raise InputError(f"--mesh {path}: expected another name, there is a {name}")
        try:
            meshes[name] = Mesh(file, scale=float(scale or 1))
        except ValueError:
            raise InputError(f"--mesh {path}: expected FILE[:SCALE]") from None
        except InputError as error:
            raise InputError(f"--mesh {path}: {error}") from None
    return meshes


def _port(text: str) -> int:
    """A port; 0 is any that is free."""
    try:
        port = int(text)
    except ValueError:
        port = -1
    if not 0 <= port < 2**16:
        raise argparse.ArgumentTypeError(f"'{text}': expected a number from 0 to 65535")
    return port
