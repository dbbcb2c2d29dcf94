"""surrogate page: write a self-contained page on which a user drags loads."""

from __future__ import annotations

import argparse
from pathlib import Path

from shared_schema.common.command_line import Commands, add_command, add_parameter
from surrogate.command_options import RUN, positive


def add_to(commands: Commands) -> None:
    """Add the command's parser."""
    parser = add_command(
        commands,
        "page",
        "write a self-contained HTML page on which a user drags loads",
        "surrogate page beam2d_any --out beam.html",
    )
    what = f"{RUN}, or the folder of a body, for its load series or actuators"
    parser.add_argument("run", type=Path, metavar="RUN", help=what)
    parser.add_argument(
        "--out", type=Path, metavar="FILE.html", help="(default: the name of RUN, in this folder)"
    )
    parser.add_argument(
        "--patch",
        type=float,
        metavar="R",
        help="radius in m of the part of the surface that a dragged force is spread over, 0 for a "
        "single node (default: as the loads of the case)",
    )
    density = "in kg/m³, of a body that moves over time (default: that of the materials)"
    parser.add_argument("--density", type=positive, metavar="RHO", help=density)
    add_parameter(parser)
    parser.set_defaults(command=run)


def run(options: argparse.Namespace) -> None:
    """Write the page, and print its size and what it leaves out."""
    import surrogate

    out = options.out or Path(f"{options.run.resolve().name}.html")
    given = {name: getattr(options, name) for name in ("patch", "parameters", "density")}
    print(f"{out}: {surrogate.write_page(options.run, out, **given).summary()}")
