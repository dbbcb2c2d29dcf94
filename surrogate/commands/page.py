"""surrogate page: write one HTML file on which one drags a load."""

from __future__ import annotations

import argparse
from pathlib import Path

from shared_schema.common.atomic_file import require_writable
from shared_schema.common.command_line import Commands, add_command
from surrogate.commands.options import RUN, warn_unsealed


def add_to(commands: Commands) -> None:
    """Add the command's parser."""
    parser = add_command(
        commands,
        "page",
        "write one HTML file on which one drags a load",
        "surrogate page beam2d_any --out beam.html",
    )
    parser.add_argument("run", type=Path, metavar="RUN", help=RUN)
    parser.add_argument(
        "--out", type=Path, metavar="FILE.html", help="(default: the name of RUN, in this folder)"
    )
    parser.set_defaults(command=run)


def run(options: argparse.Namespace) -> None:
    """Write the page, and print its size and what it leaves out."""
    from surrogate.page.page import write_page

    out = options.out or Path(f"{options.run.resolve().name}.html")
    require_writable(out)
    warn_unsealed(options.run)
    written = write_page(options.run, out)
    passes = "" if written.passes is None else f", {written.passes} passes of the network"
    estimates = "" if written.estimates else ", no estimated errors"
    print(f"{out}: {written.size / 1e6:.1f} MB{passes}{estimates}")
