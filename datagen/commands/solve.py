"""datagen solve: solve one load case and write the fields."""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from datagen.commands.options import add_case
from shared_schema.common.atomic_file import require_writable
from shared_schema.common.bodies.command_loads import CommandLoads, LoadedBody, command_loads
from shared_schema.common.bodies.load_options import STRESSES, add_loads
from shared_schema.common.command_line import Commands, add_command
from shared_schema.common.errors import InputError, WorkError
from shared_schema.common.memory import largest_resident, megabytes
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
    add_loads(parser)
    parser.add_argument(
        "--move",
        action="append",
        default=[],
        metavar="GROUP:UX,UY[,UZ]",
        help="displacement in m of a group, - for a free component; repeatable",
    )
    parser.add_argument(
        "--start",
        type=Path,
        metavar="FILE.npz",
        help="start from the displacement in this file, such as a prediction of `surrogate`",
    )
    parser.add_argument("--stresses", action="store_true", help=STRESSES)
    parser.add_argument(
        "--out",
        type=Path,
        required=True,
        metavar="FILE.(npz|vtu|xdmf)",
        help="fields at the nodes: force, displacement; with --stresses also of the cells",
    )
    parser.set_defaults(command=run)


def run(options: argparse.Namespace) -> None:
    """Solve, and say how."""
    from mpi4py import MPI

    from datagen.cases.body import make_body
    from datagen.cases.case import read_case
    from datagen.mesh.distributed_mesh import Mesh
    from datagen.solver.given_start import read_start, solve_from
    from datagen.solver.load_stepping import solve_load_case
    from datagen.solver.stresses import CellStresses, reactions_of_supports

    require_suffix(options.out)
    require_writable(options.out)
    case = read_case(options.case, options.volumetric, trust=options.trust, changes=options.changes)
    given: CommandLoads | None = None

    def driven(mesh: Mesh, held: NDArray[np.bool_]) -> CommandLoads:
        nonlocal given
        body = LoadedBody(mesh.coordinates, mesh.cells, mesh.cell_type, held, mesh.node_sets)
        given = command_loads(body, options.load, options.forces, options.move, options.nearest)
        return given

    body = make_body(case, MPI.COMM_SELF, driven)
    assert given is not None
    if options.start is not None and (given.surfaces or given.moved.any()):
        raise InputError(f"--start '{options.start}': expected forces only, no pressure or --move")
    if options.stresses and case.element != "linear":
        raise InputError(
            f"--stresses: key 'element' = '{case.element}': expected 'linear', the only elements "
            "whose stresses are computed"
        )
    if (warning := body.warning()) is not None:
        print(f"datagen: warning: {warning}", file=sys.stderr)
    for note in given.notes:
        print(note)
    nodes = np.flatnonzero(given.forces.any(axis=1))
    load, origin = (nodes, given.forces[nodes]), ""
    began = time.perf_counter()
    if options.start is None:
        drive = np.array(given.pressures), given.displacement
        report = solve_load_case(body.problem, *load, case.solver, *drive)
    else:
        start = read_start(options.start, body.mesh.coordinates)
        report, used = solve_from(start, body.problem, *load, case.solver)
        origin = f"from {options.start}, " if used else "from rest, "
    elapsed = time.perf_counter() - began
    if not report.solved:
        raise WorkError(
            f"no equilibrium found beyond {report.load_factor:.1%} of the load "
            f"({report.explanation}; {report.cutbacks} cutbacks)"
        )
    displacement, tolerance = body.problem.displacement(), body.problem.tolerance()
    grip = np.where(given.moved, body.problem.reactions(), 0.0)
    fields, of_cells = {"force": given.at_rest + grip, "displacement": displacement}, {}
    stress = ""
    if options.stresses:
        fields["reaction"] = reactions_of_supports(body.problem, body.held)
        of_cells = CellStresses(body.problem, case.materials, body.parts).fields()
        stress = f"largest von Mises stress {of_cells['von_mises'].max():.4g} Pa, "
    mesh = body.mesh.coordinates, body.mesh.cells, body.mesh.cell_type
    write_solution(options.out, *mesh, fields, of_cells)
    largest = np.linalg.norm(displacement, axis=1).max()
    print(
        f"{options.out}: largest displacement {largest:.6g} m, {stress}{origin}"
        f"{report.load_steps} load steps, {report.newton_iterations} Newton iterations, "
        f"residual {report.residual_norm:.2g} N (tolerance {tolerance:.2g} N)"
    )
    print(
        f"{body.problem.size} unknowns, {body.problem.linear_solver}: {elapsed:.3g} s a solve, "
        f"{megabytes(largest_resident())} at most"
    )
