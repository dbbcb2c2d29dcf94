"""surrogate export: write the network as a file that needs no code of this project."""

from __future__ import annotations

import argparse

from shared_schema.common.command_line import Commands, add_command, add_parameter
from surrogate.command_options import add_out, add_passes, add_run, given_passes


def add_to(commands: Commands) -> None:
    """Add the command's parser."""
    parser = add_command(
        commands,
        "export",
        "write the network as a file that needs no code of this project",
        "surrogate export beam2d_any --format onnx --out beam2d_any.onnx",
    )
    add_run(parser)
    parser.add_argument(
        "--format",
        choices=("onnx", "pt2"),
        required=True,
        help="ONNX, or a program of `torch.export`",
    )
    add_out(parser, "FILE.(onnx|pt2)", "file to write")
    add_passes(parser, "number of passes in the file (default: mean weights, without passes)")
    parser.add_argument(
        "--directions",
        type=int,
        metavar="N",
        help="directions towards the equilibrium that the file takes after the prediction",
    )
    add_parameter(parser)
    parser.set_defaults(command=run)


def run(options: argparse.Namespace) -> None:
    """Write the file, and say how much it differs from the network."""
    import surrogate

    passes = given_passes(options)
    difference = surrogate.export(
        options.run,
        options.out,
        format=options.format,
        directions=options.directions,
        parameters=options.parameters,
        **passes,
    )
    print(f"{options.out}: exported, differs from the network by {difference:.1e} relatively")
