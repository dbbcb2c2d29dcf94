"""surrogate identify: forces, their place and stiffness of a body from markers that have moved."""

from __future__ import annotations

import argparse
from pathlib import Path

from shared_schema.common.command_line import Commands, add_command, add_loads, add_tool
from surrogate.command_options import add_device, add_out, add_run, positive, relative, share

UNKNOWN = (
    "what is sought: forces at a place X,Y[,Z], on a patch X,Y[,Z],R or a group, 'somewhere' on "
    "the surface (one force; 'somewhere,R' within R m, 'somewhere,any' within a radius that is "
    "sought), 'body-force', 'pressure:GROUP', 'actuator:NAME' (its pressure or tension), "
    "'young-modulus', 'young-modulus:GROUP' of a zone; "
    "'tool' (--tool says which, and about where); repeatable"
)


def add_to(commands: Commands) -> None:
    """Add the command's parser."""
    parser = add_command(
        commands,
        "identify",
        "find forces and stiffness from markers that have moved",
        "surrogate identify beam2d_any --markers seen.csv --unknown somewhere --out found.vtu",
    )
    add_run(parser)
    lines = "lines X,Y[,Z],x,y[,z] in m: at rest, and seen (empty if not)"
    parser.add_argument("--markers", type=Path, required=True, metavar="FILE.csv", help=lines)
    parser.add_argument(
        "--unknown", action="append", required=True, metavar="PLACE|GROUP|…", help=UNKNOWN
    )
    add_loads(parser)
    add_tool(parser)
    deviation = "standard deviation of a component of the markers in m (default: estimated)"
    parser.add_argument("--noise", type=positive, metavar="S", help=deviation)
    error = (
        "standard deviation of the relative error of all displacements of this body, such as 5%% "
        "(default 0: the body is that of the run, its mesh as well)"
    )
    parser.add_argument("--model-error", type=relative, default=0.0, metavar="S", help=error)
    probability = "probability of the intervals (default 0.9)"
    parser.add_argument("--level", type=share, default=0.9, metavar="P", help=probability)
    confirm = "go on from predictions to equilibria of the finite elements"
    parser.add_argument("--confirm", action="store_true", help=confirm)
    add_out(parser, "FILE.(npz|vtu|xdmf)", "fields: displacement, std, force")
    add_device(parser)
    parser.set_defaults(command=run)


def run(options: argparse.Namespace) -> None:
    """Identify, write the fields, and print what is found."""
    import surrogate
    from shared_schema.common.files import require_writable
    from shared_schema.common.solution_file import require_suffix

    require_suffix(options.out)
    require_writable(options.out)
    found = surrogate.identify(
        surrogate.load(options.run, options.device),
        options.markers,
        options.unknown,
        [*options.load, *options.forces],
        body_force=options.body_force,
        tool=options.tool,
        noise=options.noise,
        model_error=options.model_error,
        level=options.level,
        nearest=options.nearest,
        confirm=options.confirm,
    )
    found.save(options.out)
    for line in found.lines():
        print(line)
    print(f"{options.out}: intervals of {options.level:.0%}")
