"""surrogate export: write the network as a file that needs no code of this project."""

from __future__ import annotations

import argparse
from pathlib import Path

from shared_schema.common.atomic_file import require_writable
from shared_schema.common.command_line import Commands, add_command
from surrogate.commands.options import RUN, add_passes, given_passes, warn_unsealed


def add_to(commands: Commands) -> None:
    """Add the command's parser."""
    parser = add_command(
        commands,
        "export",
        "write the network as a file that needs no code of this project",
        "surrogate export beam2d_any --format onnx --out beam2d_any.onnx",
    )
    parser.add_argument("run", type=Path, metavar="RUN", help=RUN)
    parser.add_argument(
        "--format",
        choices=("onnx", "pt2"),
        required=True,
        help="ONNX, or a program of `torch.export`",
    )
    parser.add_argument(
        "--out", type=Path, required=True, metavar="FILE.(onnx|pt2)", help="file to write"
    )
    add_passes(parser, "number of passes in the file (default: mean weights, without passes)")
    parser.set_defaults(command=run)


def run(options: argparse.Namespace) -> None:
    """Write the file, and say how much it differs from the network."""
    from surrogate.inference.export import export

    require_writable(options.out)
    warn_unsealed(options.run)
    difference = export(options.run, options.format, options.out, **given_passes(options))
    print(f"{options.out}: exported, differs from the network by {difference:.1e} relatively")
