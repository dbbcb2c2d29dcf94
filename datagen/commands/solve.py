"""datagen solve: solve one load case and write the fields."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from datagen.commands.make import add_case
from shared_schema.common.command_line import (
    STRESSES,
    Commands,
    add_command,
    add_held,
    add_loads,
    add_parameter,
    add_tool,
)
from shared_schema.common.files import require_writable
from shared_schema.common.machine import largest_resident, megabytes
from shared_schema.common.solution_file import require_suffix
from shared_schema.tools import contact_line

if TYPE_CHECKING:
    from shared_schema.samples.results import SolveReport


def add_solve(commands: Commands) -> None:
    """Add ``datagen solve``."""
    parser = add_command(
        commands,
        "solve",
        "solve one load case and write the fields",
        "datagen solve beam2d --load 4,1:0,-2.5 --out solution.vtu",
    )
    add_case(parser)
    add_loads(parser)
    add_held(parser)
    add_tool(parser)
    parser.add_argument(
        "--friction",
        type=float,
        default=0.0,
        metavar="MU",
        help="Coulomb's coefficient of friction with the tool; it needs --tool-from",
    )
    parser.add_argument(
        "--tool-from",
        action="append",
        default=[],
        metavar="DX,DY[,DZ]",
        help="where the tool comes from, in m from its place; several in turn",
    )
    parser.add_argument(
        "--actuate",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help="what is given of an actuator of the case, such as left=2.5; or NAME.KIND=VALUE, such "
        "as left.length=0.12 (tension, length, pressure, volume, gas); several",
    )
    parser.add_argument(
        "--start",
        type=Path,
        metavar="FILE.npz",
        help="start from the displacement in this file, such as a prediction of `surrogate`",
    )
    add_parameter(parser)
    parser.add_argument("--stresses", action="store_true", help=STRESSES)
    parser.add_argument(
        "--out",
        type=Path,
        required=True,
        metavar="FILE.(npz|vtu|xdmf)",
        help="fields at the nodes: force, displacement; with --stresses also of the cells",
    )
    parser.set_defaults(command=_solve, collective=True)


def _solve(options: argparse.Namespace) -> None:
    """Solve, on all ranks together, and say how."""
    from mpi4py import MPI

    from datagen import solve

    comm = MPI.COMM_WORLD
    require_suffix(options.out)
    if comm.rank == 0:
        require_writable(options.out)
    loads = ("load", "forces", "held", "tool", "friction", "tool_from", "body_force", "nearest")
    others = ("parameters", "actuate", "start", "stresses", "volumetric", "changes", "trust")
    given = {name: getattr(options, name) for name in (*loads, *others)}
    solution = solve(options.case, **given, comm=comm)
    if comm.rank > 0:
        return
    solution.save(options.out)
    report, units, stress = solution.report, solution.units, ""
    if solution.stresses:
        stress = (
            f"largest von Mises stress {solution.stresses['von_mises'].max():.4g} {units.stress}, "
        )
    begun = {"": "", "start": f"from {options.start}, ", "rest": "from rest, "}
    for note in solution.notes:
        print(note)
    if solution.contact is not None:
        print(contact_line(solution.contact, units))
    for name, actuated in solution.actuators.items():
        print(f"{name}: {actuated.written(units)}")
    print(
        f"{options.out}: largest displacement {solution.largest_displacement:.6g} {units.length}, "
        f"{stress}{begun[solution.origin]}{_stability(report)}{report.load_steps} load steps, "
        f"{report.newton_iterations} Newton iterations, "
        f"residual {report.residual_norm:.2g} {units.force} "
        f"(tolerance {solution.tolerance:.2g} {units.force})"
    )
    print(
        f"{solution.unknowns} unknowns, {solution.linear_solver}: {solution.seconds:.3g} s a "
        f"solve, {megabytes(largest_resident())} at most"
    )


def _stability(report: SolveReport) -> str:
    """Say that the equilibrium is unstable, or that an unstable one was left for it."""
    if not report.stable:
        return "an unstable equilibrium, "
    return "past an unstable equilibrium, " if report.left else ""
