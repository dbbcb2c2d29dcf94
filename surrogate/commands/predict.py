"""surrogate predict: predict one load case; certify or correct it; write the fields."""

from __future__ import annotations

import argparse

from shared_schema.common.command_line import (
    STRESSES,
    Commands,
    add_command,
    add_held,
    add_loads,
    add_parameter,
    add_tool,
)
from surrogate.command_options import add_device, add_out, add_passes, add_run, positive, share

CERTIFY = (
    "estimate the error of what is written, the prediction or (--correct) the equilibrium; add it "
    "as 'estimated_error'; 'fast' in real time, with bounds; exit code 3 where there is no "
    "estimate to trust (inverted elements, an estimate that does not settle, no fast bound), or, "
    "also without --certify, where forces are out of balance by more than the body moves"
)
TOLERANCE = (
    "largest error of a node, relative to the largest displacement, or with --certify in m: "
    "directions drive the prediction towards the equilibrium until its estimated error is small "
    "enough; exit code 3 if it is not, or not certified"
)
STIFFNESS = (
    "Young's modulus at rest in Pa, of a body of one material, or GROUP=E,… of zones of a load "
    "series (default: those of the run)"
)
BUDGET = "seconds that these directions may take, with or without a tolerance"


def add_to(commands: Commands) -> None:
    """Add the command's parser."""
    parser = add_command(
        commands,
        "predict",
        "predict one load case and write the fields",
        "surrogate predict beam2d_any --load 4,1:0,-1.5 --certify --out prediction.vtu",
    )
    add_run(parser)
    add_loads(parser)
    add_held(parser)
    add_tool(parser)
    add_parameter(parser)
    parser.add_argument("--young-modulus", type=moduli, metavar="E|GROUP=E,…", help=STIFFNESS)
    parser.add_argument("--stresses", action="store_true", help=STRESSES)
    fields = "fields at the nodes: force, displacement, standard deviations, half widths"
    add_out(parser, "FILE.(npz|vtu|xdmf)", fields)
    add_passes(parser, "number of passes of a stochastic network (default 300)")
    add_device(parser)
    bounds = "add the bounds of the run's conformal intervals: 'lower' and 'upper'"
    parser.add_argument("--conformal", choices=("marginal", "simultaneous"), help=bounds)
    parser.add_argument(
        "--certify", nargs="?", const="full", choices=("full", "fast"), help=CERTIFY
    )
    probability = "probability of the fast bounds (default 0.95)"
    parser.add_argument("--level", type=share, metavar="P", help=probability)
    parser.add_argument("--tolerance", type=positive, metavar="X", help=TOLERANCE)
    parser.add_argument("--budget", type=positive, metavar="S", help=BUDGET)
    parser.add_argument(
        "--correct",
        action="store_true",
        help="go on to the finite elements' equilibrium; add the network's as 'predicted'",
    )
    parser.set_defaults(command=run)


def moduli(text: str) -> float | dict[str, float]:
    """A positive number, or positive numbers by group."""
    if "=" not in text:
        return positive(text)
    found: dict[str, float] = {}
    for part in text.split(","):
        group, _, value = part.rpartition("=")
        if not group or group in found:
            raise argparse.ArgumentTypeError(f"'{text}': expected GROUP=E,…, each group once")
        found[group] = positive(value)
    return found


def run(options: argparse.Namespace) -> None:
    """Solve, write the fields, and say whether they are certified."""
    import surrogate
    from shared_schema.common.errors import NotCertifiedError
    from shared_schema.common.files import require_writable
    from shared_schema.common.solution_file import require_suffix
    from surrogate.mechanics.body.elements_of_case import warn_of_locking

    require_suffix(options.out)
    require_writable(options.out)
    model, young_modulus = surrogate.load(options.run, options.device), options.young_modulus
    warn_of_locking(model.description.data.case, model.geometry.cell_type)
    if isinstance(young_modulus, dict):
        model, young_modulus = model.with_young_moduli(young_modulus), None
    solution = model.solve(
        [*options.load, *options.forces],
        held=options.held or None,
        tool=options.tool,
        body_force=options.body_force,
        young_modulus=young_modulus,
        certify=options.certify,
        correct=options.correct,
        tolerance=options.tolerance,
        budget=options.budget,
        level=options.level,
        conformal=options.conformal,
        stresses=options.stresses,
        nearest=options.nearest,
        passes=options.passes,
        seed=options.seed,
        parameters=options.parameters,
    )
    for note in solution.notes:
        print(note)
    solution.save(options.out)
    reactions = () if solution.grips is None else solution.grips
    for text, reaction in zip(options.held, reactions, strict=True):
        print(f"{text}: held by {','.join(f'{force:.6g}' for force in reaction)} N")
    if solution.contact is not None:
        from shared_schema.tools import contact_line

        print(contact_line(solution.contact, solution.units))
    print(f"{options.out}: largest displacement {solution.largest}; {solution.summary()}")
    if solution.refusal is not None:
        raise NotCertifiedError(solution.refusal)
