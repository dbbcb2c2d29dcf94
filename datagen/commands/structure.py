"""datagen structure: map a nodal dataset to its grid."""

from __future__ import annotations

import argparse
from pathlib import Path

from datagen.commands.options import add_nodal
from shared_schema.common.command_line import Commands, add_command
from shared_schema.grid import IN_A_ROW


def add_to(commands: Commands) -> None:
    """Add the command's parser."""
    parser = add_command(
        commands,
        "structure",
        "map a nodal dataset to its grid",
        "datagen structure data/beam2d/nodal --out data/beam2d/structured",
    )
    add_nodal(parser)
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="dataset to make")
    parser.add_argument(
        "--order",
        choices=("preferred", "gmsh", "random"),
        default="preferred",
        help="assignment of nodes to grid points (default: by position in space)",
    )
    parser.add_argument(
        "--order-seed", type=int, default=0, metavar="S", help="seed of a random order (default 0)"
    )
    parser.add_argument(
        "--grid",
        type=grid_shape,
        metavar="NX,NY[,NZ]|nodes",
        help="embed a grid of this many points, or put all nodes in a row, for models of modes "
        "(default: the mesh's own grid, or one as fine as the mesh)",
    )
    parser.add_argument(
        "--error",
        type=float,
        metavar="E",
        help="embed the coarsest grid to which and back displacements differ by no more in the "
        "mean, such as 0.01",
    )
    parser.set_defaults(command=run)


def grid_shape(text: str) -> tuple[int, ...] | str:
    """Read the numbers of points of a grid, or `nodes`; ArgumentTypeError if it is neither."""
    if text == IN_A_ROW:
        return text
    try:
        return tuple(int(count) for count in text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(
            f"'{text}': expected NX,NY or NX,NY,NZ, or {IN_A_ROW}"
        ) from None


def run(options: argparse.Namespace) -> None:
    """Make the structured dataset, and say how large it is."""
    from datagen import structure

    names = "order", "order_seed", "grid", "error"
    given = {name: getattr(options, name) for name in names}
    info = structure(options.nodal, options.out, **given).structured
    assert info is not None
    shape = " x ".join(str(n) for n in info.grid_shape)
    print(f"{options.out}: {info.train} training and {info.test} test samples on a {shape} grid")
    if info.embedding is not None:
        print(
            "embedded on the mesh; displacements to the grid and back differ by "
            f"{info.embedding.mean_error:.2%} in the mean, {info.embedding.max_error:.2%} at most"
        )
