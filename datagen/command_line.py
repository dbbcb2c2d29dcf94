"""The command ``datagen``: makes, checks and shows datasets."""

from __future__ import annotations

import argparse
import logging
import os
import sys
import time
import traceback
from collections.abc import Callable, Sequence
from importlib.util import find_spec

for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")  # before numpy loads: only ranks run in parallel
# PETSc's own handler ends a closed pipe with an abort; without it Python raises BrokenPipeError
os.environ["PETSC_OPTIONS"] = f"{os.environ.get('PETSC_OPTIONS', '')} -no_signal_handler".strip()

from datagen.commands.export import add_export
from datagen.commands.make import add_body, add_noise, add_repair, add_run, add_structure
from datagen.commands.publish import add_publish
from datagen.commands.show import add_check, add_info, add_list, add_plot, add_schema
from datagen.commands.solve import add_solve
from datagen.needed import solvers_named
from shared_schema.common.command_line import Parser, make_parser, parsed, run_command
from shared_schema.common.errors import FAILED, InputError, StoppedError

COMMANDS = (
    *(add_body, add_run, add_structure, add_noise, add_solve, add_check, add_repair),
    *(add_info, add_plot, add_export, add_publish, add_list, add_schema),
)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; return its exit code (0 done, 1 failed, 2 wrong input)."""
    given = sys.argv[1:] if arguments is None else arguments
    options = parsed(_parser(), given)
    # dolfinx reads the words for itself, as UTF-8
    sys.argv = [word.encode(errors="replace").decode() for word in sys.argv]
    command: Callable[[argparse.Namespace], None] = options.command

    def run() -> None:
        with solvers_named(f"datagen {given[0]}"):
            command(options)

    if "collective" in options and find_spec("mpi4py") is not None:
        return _on_every_rank(run)
    return run_command("datagen", run)


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
    if comm.rank > 0:  # every rank reads the case, one says what is unusual about it
        for name in ("shared_schema.common.configuration", "datagen.solution"):
            logging.getLogger(name).setLevel(logging.ERROR)
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


def _parser() -> Parser:
    from datagen import __version__

    description = "Make datasets of large-deformation equilibria under families of nodal loads."
    parser, commands = make_parser("datagen", description, __version__, {"case": _case_names})
    for command in COMMANDS:
        command(commands)
    return parser


def _case_names() -> list[str]:
    from datagen.cases.case import SHIPPED
    from shared_schema.common.configuration import names_in

    return names_in(SHIPPED)


if __name__ == "__main__":
    sys.exit(main())
