"""surrogate actuate: what the actuators of a body do, and which values of them reach a target."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from shared_schema.common.command_line import Commands, add_command
from surrogate.command_options import positive, whole

if TYPE_CHECKING:
    from surrogate.mechanics.actuation.actuation import Actuation

BODY = "folder of a body with actuators (datagen body, or a dataset), or a run folder"
GIVEN = (
    "what is given of an actuator, in the unit that the case has for it, or as NAME.KIND=VALUE "
    "(tension N, length m, pressure Pa, volume m³, gas Pa); repeatable"
)
TARGET = "where the mean of the nodes of a group, or the node next to X,Y[,Z], shall be, in m"
MODES = "file of the modes of the body; made where it is not there (default: in the folder)"


def add_to(commands: Commands) -> None:
    """Add the command's parser."""
    parser = add_command(
        commands,
        "actuate",
        "find what actuators do, or which values of them reach a target",
        "surrogate actuate data/trunk --target tip:0.1,0.05,0.25 --out reached.vtu",
        "surrogate actuate data/trunk --given tip1=3 --out bent.vtu",
    )
    parser.add_argument("body", type=Path, metavar="BODY", help=BODY)
    parser.add_argument("--given", action="append", default=[], metavar="NAME=VALUE", help=GIVEN)
    place = "GROUP|X,Y[,Z]:X,Y[,Z]"
    parser.add_argument("--target", action="append", default=[], metavar=place, help=TARGET)
    look = "where the surface of a group shall look in the mean; repeatable"
    parser.add_argument(
        "--orientation", action="append", default=[], metavar="GROUP:NX,NY[,NZ]", help=look
    )
    limits = "limits of an actuator, in place of those of the case; repeatable"
    parser.add_argument(
        "--within", action="append", default=[], metavar="NAME=LOW:HIGH", help=limits
    )
    load = "dead load that acts as well, as of predict; repeatable"
    parser.add_argument("--load", action="append", default=[], metavar="PLACE:F", help=load)
    effort = "weight of what actuators do, beside the distance from targets (default 1e-3)"
    parser.add_argument("--effort", type=positive, metavar="E", help=effort)
    parser.add_argument("--modes", type=Path, metavar="FILE", help=MODES)
    samples = "equilibria that the modes are made of; new ones if they are of fewer (default 128)"
    parser.add_argument("--samples", type=whole, metavar="N", help=samples)
    certify = "estimate the error of the modes, under the tensions and pressures that are found"
    parser.add_argument("--certify", action="store_true", help=certify)
    confirm = "go on from the modes to the equilibrium of the finite elements"
    parser.add_argument("--confirm", action="store_true", help=confirm)
    parser.add_argument("--out", type=Path, metavar="FILE.(npz|vtu|xdmf)", help="displacement")
    parser.set_defaults(command=run)


def run(options: argparse.Namespace) -> None:
    """Find them, write the displacement, and print what is given and found."""
    from shared_schema.common.errors import InputError
    from shared_schema.common.files import require_writable
    from shared_schema.common.solution_file import require_suffix
    from surrogate.mechanics.actuation.targets import REACHED

    if options.out is not None:
        require_suffix(options.out)
        require_writable(options.out)
    reaching = bool(options.target or options.orientation)
    if reaching == bool(options.given):
        raise InputError("expected either --given, or --target and --orientation")
    targets = _by_name("--target", options.target, ":", ",")
    directions = _by_name("--orientation", options.orientation, ":", ",")
    within = _by_name("--within", options.within, "=", ":")
    wrong = next((name for name, each in within.items() if len(each) != 2), None)
    if wrong is not None:
        raise InputError(f"--within '{wrong}': expected NAME=LOW:HIGH")
    model = _model(options)
    if reaching:
        limits = {name: (low, high) for name, (low, high) in within.items()}
        effort = {} if options.effort is None else {"effort": options.effort}
        found = model.reach(targets, directions, within=limits, load=options.load, **effort)
    else:
        found = model.at(options.given, options.load)
    if options.confirm:
        found = model.confirmed(found, options.load)
    for line in found.lines():
        print(line)
    print(f"largest displacement {found.largest:.4g} m")
    if options.certify:
        print(model.certify(found, options.load).summary())
    if reaching and targets:
        far = found.missed > REACHED * model.size
        out_of_reach = ", out of reach of the actuators: this is the nearest" if far else ""
        print(f"targets missed by {found.missed:.3g} m{out_of_reach}")
    if options.out is not None:
        found.save(options.out)


def _model(options: argparse.Namespace) -> Actuation:
    """Read the modes of the body, or make and keep them."""
    import surrogate
    from surrogate.mechanics.statics.body import Body

    is_run = (options.body / "config.yaml").is_file()
    body = surrogate.load(options.body).body if is_run else Body.read(options.body)
    given = {"samples": options.samples, "file": options.modes}
    return surrogate.Actuation.of_folder(options.body, body, options.load, **given)


def _by_name(
    option: str, texts: list[str], before: str, between: str
) -> dict[str, tuple[float, ...]]:
    """Numbers by names, of texts such as NAME:X,Y."""
    from shared_schema.common.errors import InputError

    found: dict[str, tuple[float, ...]] = {}
    for text in texts:
        name, _, values = text.rpartition(before) if before == ":" else text.partition(before)
        try:
            numbers = tuple(float(part) for part in values.split(between))
        except ValueError:
            numbers = ()
        if not name or not numbers or name in found:
            raise InputError(f"{option} '{text}': expected NAME{before}NUMBERS, each name once")
        found[name] = numbers
    return found
