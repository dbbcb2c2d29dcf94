"""datagen solve: solve one load case and write the fields."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

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
from shared_schema.common.errors import InputError
from shared_schema.common.files import require_writable
from shared_schema.common.machine import largest_resident, megabytes
from shared_schema.common.solution_file import require_suffix
from shared_schema.tools import contact_line

if TYPE_CHECKING:
    from shared_schema.samples.results import SolveReport


LOADS = (  # arguments that a solve and a motion share
    *("load", "forces", "held", "tool", "friction", "tool_from", "body_force", "nearest"),
    *("parameters", "actuate", "volumetric", "changes", "trust"),
)


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
    parser.add_argument(
        "--duration",
        type=float,
        metavar="T",
        help="let the body move for T seconds, with the settings of the case's key time",
    )
    parser.add_argument("--step", type=float, metavar="H", help="time step in s of a motion")
    parser.add_argument(
        "--history",
        metavar="held|let_go|ramp=S|random=HZ",
        help="load over time of a motion: held from the begin (default), let go from equilibrium, "
        "grown in S seconds, or varied at random up to a frequency",
    )
    add_parameter(parser)
    parser.add_argument("--stresses", action="store_true", help=STRESSES)
    parser.add_argument(
        "--out",
        type=Path,
        required=True,
        metavar="FILE.(npz|vtu|xdmf)",
        help="fields at the nodes: force, displacement; with --stresses also of the cells; of a "
        "motion the frames, .npz, .xdmf or .pvd",
    )
    parser.set_defaults(command=_solve, collective=True)


def _solve(options: argparse.Namespace) -> None:
    """Solve, on all ranks together, and say how."""
    from mpi4py import MPI

    from datagen import solve

    comm = MPI.COMM_WORLD
    if options.duration is not None:
        _move(options, comm)
        return
    if options.step is not None or options.history is not None:
        raise InputError("--step and --history: expected with --duration")
    require_suffix(options.out)
    if comm.rank == 0:
        require_writable(options.out)
    others = "start", "stresses"
    given = {name: getattr(options, name) for name in (*LOADS, *others)}
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


def _move(options: argparse.Namespace, comm: Any) -> None:
    """Let the body move, on all ranks together, and say how."""
    from datagen import move
    from datagen.motion.moved_body import FORMATS

    if options.start is not None or options.stresses:
        raise InputError("--start and --stresses: expected without --duration")
    require_suffix(options.out, FORMATS)
    if comm.rank == 0:
        require_writable(options.out)
    names = (*LOADS, "duration", "step", "history")
    moved = move(options.case, **{name: getattr(options, name) for name in names}, comm=comm)
    if comm.rank > 0:
        return
    moved.save(options.out)
    for note in moved.notes:
        print(note)
    found, units = moved.trajectory, moved.units
    of_energies = "kinetic", "strain", "work", "dissipated"
    unit = f"{units.force} {units.length}"
    energies = ", ".join(
        f"{name} {energy:.4g}" for name, energy in zip(of_energies, found.energies[-1], strict=True)
    )
    print(
        f"{options.out}: {len(found.times)} frames to {found.times[-1]:.6g} s, largest "
        f"displacement {moved.largest_displacement:.6g} {units.length}"
    )
    print(f"energies at the end in {unit}: {energies}")
    print(
        f"{moved.unknowns} unknowns, {moved.settings.steps} steps: {moved.seconds:.3g} s, "
        f"{megabytes(largest_resident())} at most"
    )


def _stability(report: SolveReport) -> str:
    """Say that the equilibrium is unstable, or that an unstable one was left for it."""
    if not report.stable:
        return "an unstable equilibrium, "
    return "past an unstable equilibrium, " if report.left else ""
