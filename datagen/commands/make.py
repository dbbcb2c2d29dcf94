"""Commands that make datasets: ``body``, ``run``, ``structure``, ``noise``; and ``repair``."""

from __future__ import annotations

import argparse
from pathlib import Path

from shared_schema.common.command_line import Commands, Parser, add_command, add_set
from shared_schema.grid import IN_A_ROW

CASE = "YAML file, or the name of a shipped case"
VOLUMETRIC = ("paper", "quadratic")
TRUST = "allow the case's gmsh script to run programs and to read and write files"


def add_case(parser: Parser) -> None:
    """Add CASE, --volumetric, --trust and --set."""
    parser.add_argument("case", metavar="CASE", help=CASE)
    parser.add_argument(
        "--volumetric", choices=VOLUMETRIC, help="volumetric term instead of the case's"
    )
    parser.add_argument("--trust", action="store_true", help=TRUST)
    add_set(parser, "the case", "material.poisson_ratio=0.3")


def add_nodal(parser: Parser) -> None:
    """Add NODAL_DIR."""
    parser.add_argument(
        "nodal", type=Path, metavar="NODAL_DIR", help="nodal dataset, as `datagen run` makes it"
    )


def add_body(commands: Commands) -> None:
    """Add ``datagen body``."""
    parser = add_command(
        commands,
        "body",
        "make the dataset of a body without samples, for a surrogate that needs none",
        "datagen body beam3d_any --out data/beam3d_any/body",
        "datagen body plate2d --set mesh.parameters.radius=0.2 --out data/plate2d/body",
    )
    add_case(parser)
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="dataset to make")
    parser.set_defaults(command=_body)


def _body(options: argparse.Namespace) -> None:
    """Make the dataset, and say how large the body is."""
    import datagen

    given = {name: getattr(options, name) for name in ("volumetric", "changes", "trust")}
    manifest = datagen.body(options.case, options.out, **given)
    print(f"{options.out}: body of {manifest.name}, without samples")


def add_repair(commands: Commands) -> None:
    """Add ``datagen repair``."""
    parser = add_command(
        commands,
        "repair",
        "make one closed surface of triangles that are open, cut each other or lie badly",
        "datagen repair scan.stl --out organ.stl --size 4",
    )
    parser.add_argument("surface", type=Path, metavar="SURFACE", help="STL, OBJ or PLY")
    parser.add_argument(
        "--out", type=Path, required=True, metavar="FILE.(stl|obj|ply)", help="surface to write"
    )
    parser.add_argument(
        "--size",
        type=float,
        metavar="H",
        help="length of the new edges, in the unit of the file (default: 1/20 of the diagonal)",
    )
    parser.set_defaults(command=_repair)


def _repair(options: argparse.Namespace) -> None:
    """Repair the surface, and say how many triangles it has."""
    import datagen

    count = datagen.repair(options.surface, options.out, size=options.size)
    print(f"{options.out}: closed surface of {count} triangles")


def add_run(commands: Commands) -> None:
    """Add ``datagen run``."""
    parser = add_command(
        commands,
        "run",
        "solve every load case of a case (under mpirun, or not)",
        "mpirun -n 2 datagen run beam2d --out data/beam2d/nodal --samples 1000",
    )
    add_case(parser)
    parser.add_argument(
        "--out", type=Path, required=True, metavar="DIR", help="nodal dataset to make"
    )
    parser.add_argument(
        "--samples", type=int, metavar="K", help="number of samples instead of the case's"
    )
    parser.add_argument(
        "--loads",
        type=Path,
        metavar="LOADS.h5",
        help="solve the load cases of a file (shared_schema.load_cases)",
    )
    parser.add_argument(
        "--ranks-per-solve", type=int, default=1, metavar="R", help="ranks that share each solve"
    )
    parser.set_defaults(command=_run, collective=True)


def _run(options: argparse.Namespace) -> None:
    """Make the dataset, or resume it (collective)."""
    from mpi4py import MPI

    import datagen

    names = "samples", "volumetric", "changes", "loads", "trust", "ranks_per_solve"
    given = {name: getattr(options, name) for name in names}
    manifest = datagen.run(options.case, options.out, **given)
    if MPI.COMM_WORLD.rank == 0:
        print(f"{options.out}: {manifest.samples} samples solved, {manifest.failed} failed")


def add_structure(commands: Commands) -> None:
    """Add ``datagen structure``."""
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
    parser.set_defaults(command=_structure)


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


def _structure(options: argparse.Namespace) -> None:
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


def add_noise(commands: Commands) -> None:
    """Add ``datagen noise``."""
    parser = add_command(
        commands,
        "noise",
        "copy a nodal dataset with noise on small loads",
        "datagen noise data/beam2d/nodal --out data/beam2d-noisy/nodal --relative 0.1",
    )
    add_nodal(parser)
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="dataset to make")
    parser.add_argument(
        "--seed", type=int, default=0, metavar="S", help="seed of the noise (default 0)"
    )
    parser.add_argument(
        "--relative",
        type=float,
        default=0.2,
        metavar="R",
        help="largest relative change (default 0.2)",
    )
    parser.add_argument(
        "--threshold",
        type=float,
        default=0.7,
        metavar="F",
        help="largest |f| with noise, in N (default 0.7)",
    )
    parser.set_defaults(command=_noise)


def _noise(options: argparse.Namespace) -> None:
    """Make the copy."""
    from datagen import add_noise

    given = {name: getattr(options, name) for name in ("seed", "relative", "threshold")}
    manifest = add_noise(options.nodal, options.out, **given)
    print(f"{options.out}: {manifest.samples} samples with noise")
