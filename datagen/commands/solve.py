"""datagen solve: solve one load case and write the fields."""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from datagen.commands.options import add_case
from shared_schema.common.atomic_file import require_writable
from shared_schema.common.command_line import Commands, add_command
from shared_schema.common.errors import WorkError
from shared_schema.common.point_load import nodal_forces
from shared_schema.common.solution_file import require_suffix, write_solution


def add_to(commands: Commands) -> None:
    """Add the command's parser."""
    parser = add_command(
        commands,
        "solve",
        "solve one load case and write the fields",
        "datagen solve beam2d --load 4,1:0,-2.5 --out solution.vtu",
    )
    add_case(parser)
    parser.add_argument(
        "--load",
        action="append",
        required=True,
        metavar="X,Y[,Z]:FX,FY[,FZ]",
        help="force in N at the node at X,Y[,Z] in m; repeatable",
    )
    parser.add_argument(
        "--start",
        type=Path,
        metavar="FILE.npz",
        help="start from the displacement in this file, such as a prediction of `surrogate`",
    )
    parser.add_argument(
        "--out",
        type=Path,
        required=True,
        metavar="FILE.(npz|vtu|xdmf)",
        help="fields at the nodes: force, displacement",
    )
    parser.set_defaults(command=run)


def run(options: argparse.Namespace) -> None:
    """Solve, and say how."""
    from mpi4py import MPI

    from datagen.cases.body import make_body
    from datagen.cases.case import read_case
    from datagen.solver.given_start import read_start, solve_from
    from datagen.solver.load_stepping import solve_load_case

    require_suffix(options.out)
    require_writable(options.out)
    case = read_case(options.case, options.volumetric, trust=options.trust, changes=options.changes)
    body = make_body(case, MPI.COMM_SELF)
    forces = nodal_forces(options.load, body.mesh.coordinates, body.clamped)
    nodes = np.flatnonzero(forces.any(axis=1))
    origin = ""
    if options.start is None:
        report = solve_load_case(body.problem, nodes, forces[nodes], case.solver)
    else:
        start = read_start(options.start, body.mesh.coordinates)
        report, used = solve_from(start, body.problem, nodes, forces[nodes], case.solver)
        origin = f"from {options.start}, " if used else "from rest, "
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
        f"residual {report.residual_norm:.2g} N"
    )
