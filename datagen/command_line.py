"""The command ``datagen``: makes, checks and shows datasets."""

from __future__ import annotations

import argparse
import logging
import os
import sys
import time
import traceback
from collections.abc import Callable, Sequence
from pathlib import Path

for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")  # before numpy loads: only ranks run in parallel

import numpy as np

from datagen import __version__
from shared_schema.checker import check_dataset
from shared_schema.common.atomic_file import require_writable
from shared_schema.common.command_line import make_parser, run_command
from shared_schema.common.errors import FAILED, InputError, StoppedError, WorkError
from shared_schema.common.memory import largest_resident, megabytes
from shared_schema.common.point_load import nodal_forces
from shared_schema.common.solution_file import require_suffix, write_solution

VOLUMETRIC = ("paper", "quadratic")
TRUST = "allow the case's gmsh script to run programs and to read and write files"


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; return its exit code (0 done, 1 failed, 2 wrong input)."""
    options = _parser().parse_args(arguments)
    logging.disable(logging.INFO)  # ffcx and setuptools log every compiler call
    command: Callable[[argparse.Namespace], None] = options.command
    if command is _run:
        return _on_every_rank(lambda: _run(options))
    return run_command("datagen", lambda: command(options))


def _on_every_rank(command: Callable[[], None]) -> int:
    """Run a collective command on every rank, and return its exit code.

    Errors that every rank raises (wrong input, a stop) are printed once, by rank 0. An error on one
    rank alone is printed by that rank, which then ends the others, since they may wait for it.
    """
    from mpi4py import MPI

    from datagen.farm.farm import NothingSolvedError
    from datagen.ranks import FirstOfNode

    comm = MPI.COMM_WORLD
    first = FirstOfNode(comm)
    alone = False

    def watched() -> None:
        nonlocal alone
        try:
            command()
        except (InputError, StoppedError):
            raise
        except NothingSolvedError:
            if comm.rank == 0:
                raise
            raise StoppedError from None  # without a word
        except BaseException:
            while not first.claim():
                time.sleep(1)  # until the first rank of this node that failed ends this one
            alone = True
            raise

    try:
        code = run_command("datagen", watched, speaks=comm.rank == 0 or alone)
    except BaseException:
        traceback.print_exc()
        code = FAILED
    if alone and comm.size > 1:
        comm.Abort(FAILED)
    first.close()
    return code


def _parser() -> argparse.ArgumentParser:
    description = "Make datasets of large-deformation equilibria under families of nodal loads."
    parser, commands = make_parser("datagen", description, __version__)

    run = commands.add_parser("run", help="solve every load case of a case (under mpirun, or not)")
    run.add_argument("case", metavar="CASE", help="YAML file, or the name of a shipped case")
    run.add_argument("--out", type=Path, required=True, metavar="DIR", help="nodal dataset to make")
    run.add_argument(
        "--samples", type=int, metavar="K", help="number of samples instead of the case's"
    )
    run.add_argument(
        "--ranks-per-solve", type=int, default=1, metavar="R", help="ranks that share each solve"
    )
    run.add_argument(
        "--volumetric", choices=VOLUMETRIC, help="volumetric term instead of the case's"
    )
    run.add_argument("--trust", action="store_true", help=TRUST)
    run.set_defaults(command=_run)

    structure = commands.add_parser("structure", help="map a nodal dataset to its grid")
    structure.add_argument("nodal", type=Path, metavar="NODAL_DIR")
    structure.add_argument("--out", type=Path, required=True, metavar="DIR")
    structure.add_argument(
        "--order",
        choices=("preferred", "gmsh", "random"),
        default="preferred",
        help="assignment of nodes to grid points (default: by position in space)",
    )
    structure.add_argument("--order-seed", type=int, default=0, metavar="S")
    structure.add_argument(
        "--grid",
        type=_grid_shape,
        metavar="NX,NY[,NZ]",
        help="embed a grid of this many points (default: the mesh's own, or as fine as the mesh)",
    )
    structure.set_defaults(command=_structure)

    noise = commands.add_parser("noise", help="copy a nodal dataset with noise on small loads")
    noise.add_argument("nodal", type=Path, metavar="NODAL_DIR")
    noise.add_argument("--out", type=Path, required=True, metavar="DIR")
    noise.add_argument("--seed", type=int, default=0, metavar="S")
    noise.add_argument("--relative", type=float, default=0.2, help="largest relative change")
    noise.add_argument("--threshold", type=float, default=0.7, help="largest |f| with noise, in N")
    noise.set_defaults(command=_noise)

    solve = commands.add_parser("solve", help="solve one load case and write the fields")
    solve.add_argument("case", metavar="CASE", help="YAML file, or the name of a shipped case")
    solve.add_argument(
        "--load", action="append", required=True, metavar="X,Y[,Z]:FX,FY[,FZ]", help="repeatable"
    )
    solve.add_argument(
        "--volumetric", choices=VOLUMETRIC, help="volumetric term instead of the case's"
    )
    solve.add_argument(
        "--start",
        type=Path,
        metavar="FILE.npz",
        help="start from the displacement in this file, such as a prediction of `surrogate`",
    )
    solve.add_argument("--out", type=Path, required=True, metavar="FILE.(npz|vtu|xdmf)")
    solve.add_argument("--trust", action="store_true", help=TRUST)
    solve.set_defaults(command=_solve)

    check = commands.add_parser("check", help="check every byte of a dataset against the schema")
    check.add_argument("dataset", type=Path, metavar="DIR")
    check.set_defaults(command=_check)

    info = commands.add_parser("info", help="summarise a dataset")
    info.add_argument("dataset", type=Path, metavar="DIR")
    info.add_argument(
        "--figure", type=Path, metavar="FILE", help="draw the dataset as well, as `plot` does"
    )
    info.set_defaults(command=_info)

    plot = commands.add_parser("plot", help="draw mesh, supports and some samples of a dataset")
    plot.add_argument("nodal", type=Path, metavar="NODAL_DIR")
    plot.add_argument("--out", type=Path, required=True, metavar="FILE.(png|svg|pdf)")
    plot.add_argument(
        "--samples", metavar="N,N,…", help="sample numbers instead of four chosen by displacement"
    )
    plot.set_defaults(command=_plot)

    export = commands.add_parser("export", help="write samples as a time series for ParaView")
    export.add_argument("nodal", type=Path, metavar="NODAL_DIR")
    export.add_argument("--out", type=Path, required=True, metavar="FILE.(xdmf|pvd)")
    export.add_argument("--samples", metavar="A:B", help="A to B - 1 instead of the first 100")
    export.set_defaults(command=_export)
    return parser


def _run(options: argparse.Namespace) -> None:
    from mpi4py import MPI

    from datagen.cases.case import read_case
    from datagen.farm.farm import run

    case = read_case(options.case, options.volumetric, options.samples, options.trust)
    manifest = run(case, options.out, MPI.COMM_WORLD, options.ranks_per_solve)
    if MPI.COMM_WORLD.rank == 0:
        print(f"{options.out}: {manifest.samples} samples solved, {manifest.failed} failed")


def _structure(options: argparse.Namespace) -> None:
    from datagen.structure.reindexing import structure

    order = options.order, options.order_seed
    info = structure(options.nodal, options.out, *order, options.grid).structured
    assert info is not None
    shape = " x ".join(str(n) for n in info.grid_shape)
    print(f"{options.out}: {info.train} training and {info.test} test samples on a {shape} grid")
    if info.embedding is not None:
        print(
            "embedded on the mesh; displacements to the grid and back differ by "
            f"{info.embedding.mean_error:.2%} in the mean, {info.embedding.max_error:.2%} at most"
        )


def _grid_shape(text: str) -> tuple[int, ...]:
    try:
        return tuple(int(count) for count in text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"'{text}': expected NX,NY or NX,NY,NZ") from None


def _noise(options: argparse.Namespace) -> None:
    from datagen.structure.noise import add_noise

    manifest = add_noise(
        options.nodal, options.out, options.seed, options.relative, options.threshold
    )
    print(f"{options.out}: {manifest.samples} samples with noise")


def _solve(options: argparse.Namespace) -> None:
    from mpi4py import MPI

    from datagen.cases.body import make_body
    from datagen.cases.case import read_case
    from datagen.solver.given_start import read_start, solve_from
    from datagen.solver.load_stepping import solve_load_case

    require_suffix(options.out)
    require_writable(options.out)
    case = read_case(options.case, options.volumetric, trust=options.trust)
    body = make_body(case, MPI.COMM_SELF)
    if (warning := body.warning()) is not None:
        print(f"datagen: warning: {warning}", file=sys.stderr)
    forces = nodal_forces(options.load, body.mesh.coordinates, body.clamped)
    nodes = np.flatnonzero(forces.any(axis=1))
    origin = ""
    began = time.perf_counter()
    if options.start is None:
        report = solve_load_case(body.problem, nodes, forces[nodes], case.solver)
    else:
        start = read_start(options.start, body.mesh.coordinates)
        report, used = solve_from(start, body.problem, nodes, forces[nodes], case.solver)
        origin = f"from {options.start}, " if used else "from rest, "
    elapsed = time.perf_counter() - began
    if not report.solved:
        raise WorkError(
            f"no equilibrium found beyond {report.load_factor:.1%} of the load "
            f"({report.explanation}; {report.cutbacks} cutbacks)"
        )
    displacement = body.problem.displacement()
    write_solution(
        options.out,
        body.mesh.coordinates,
        body.mesh.cells,
        body.mesh.cell_type,
        {"force": forces, "displacement": displacement},
    )
    largest = np.linalg.norm(displacement, axis=1).max()
    print(
        f"{options.out}: largest displacement {largest:.6g} m, {origin}"
        f"{report.load_steps} load steps, {report.newton_iterations} Newton iterations, "
        f"residual {report.residual_norm:.2g} N (tolerance {body.problem.tolerance():.2g} N)"
    )
    print(
        f"{body.problem.size} unknowns, {body.problem.linear_solver}: {elapsed:.3g} s a solve, "
        f"{megabytes(largest_resident())} at most"
    )


def _check(options: argparse.Namespace) -> None:
    problems = check_dataset(options.dataset)
    if len(problems) == 1:
        raise InputError(problems[0])
    if problems:
        print("\n".join(problems), file=sys.stderr)
        raise InputError(f"{options.dataset}: {len(problems)} violations of the schema")
    print(f"{options.dataset}: intact")


def _info(options: argparse.Namespace) -> None:
    from datagen.output.info import summary

    if options.figure is not None:
        from datagen.output.dataset_figure import SUFFIXES, plot_dataset

        require_suffix(options.figure, SUFFIXES, "--figure")
        require_writable(options.figure, "--figure")
        plot_dataset(options.dataset, options.figure)
    print(summary(options.dataset))


def _plot(options: argparse.Namespace) -> None:
    from datagen.output.dataset_figure import SUFFIXES, plot_dataset

    require_suffix(options.out, SUFFIXES)
    require_writable(options.out)
    numbers = plot_dataset(options.nodal, options.out, options.samples)
    print(f"{options.out}: samples {', '.join(str(number) for number in numbers)}")


def _export(options: argparse.Namespace) -> None:
    from datagen.output.export import SUFFIXES, export

    require_suffix(options.out, SUFFIXES)
    require_writable(options.out)
    numbers = export(options.nodal, options.out, options.samples)
    print(f"{options.out}: {len(numbers)} samples, {numbers[0]} to {numbers[-1]}")


if __name__ == "__main__":
    sys.exit(main())
