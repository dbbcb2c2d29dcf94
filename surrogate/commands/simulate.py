"""surrogate simulate: a body in motion, under a load over time or as a script tells it."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from shared_schema.common.command_line import Commands, add_command, add_loads
from surrogate.command_options import add_out, positive

if TYPE_CHECKING:
    from surrogate.mechanics.statics.body import Body

BODY = "run folder, a trained network of the package, or a body of `datagen body`"
FILMS = (".gif", ".mp4")
SUFFIXES = (".npz", ".pvd", *FILMS)
HISTORY = "factor of the load over time: held (default), let_go, ramp=SECONDS or random=HERTZ"
SCRIPT = "YAML file of the step and of phases with seconds, load, tool, held, actuate and moving"


def add_to(commands: Commands) -> None:
    """Add the command's parser."""
    parser = add_command(
        commands,
        "simulate",
        "let a body move in time",
        "surrogate simulate beam2d_any --density 0.1 --duration 2 --step 0.01 --load 4,1:0,-1 "
        "--history let_go --out motion.gif",
        "surrogate simulate beam2d_any --density 0.1 --script script.yaml --out motion.npz",
    )
    parser.add_argument("run", type=Path, metavar="BODY", help=BODY)
    parser.add_argument("--duration", type=positive, metavar="T", help="in s")
    parser.add_argument("--step", type=positive, metavar="H", help="time step in s")
    add_loads(parser)
    parser.add_argument("--history", default="held", metavar="HISTORY", help=HISTORY)
    parser.add_argument("--seed", type=int, default=0, metavar="S", help="of a random history")
    parser.add_argument("--script", type=Path, metavar="FILE", help=SCRIPT)
    density = "in kg/m³ (default: that of the materials)"
    parser.add_argument("--density", type=positive, metavar="RHO", help=density)
    error = "largest error that a step adds, over the largest displacement (default 5e-3)"
    parser.add_argument("--tolerance", type=positive, metavar="E", help=error)
    add_out(parser, "FILE.(npz|pvd|gif|mp4)", "frames: numbers, a ParaView series, or a film")
    parser.set_defaults(command=run)


def run(options: argparse.Namespace) -> None:
    """Take the steps, write the frames, and say what they are."""
    from shared_schema.common.bodies.command_loads import command_loads
    from shared_schema.common.errors import InputError
    from shared_schema.common.files import require_writable
    from shared_schema.common.solution_file import require_suffix
    from shared_schema.motion import LoadOverTime, read_history
    from surrogate.mechanics.motion.session import Session
    from surrogate.mechanics.motion.simulation import Recording, Script, under_load
    from surrogate.mechanics.statics.load import Load

    require_suffix(options.out, SUFFIXES)
    require_writable(options.out)
    timed = options.duration is not None and options.step is not None
    if timed == (options.script is not None):
        raise InputError("expected either --duration and --step, or --script")
    script = None if options.script is None else Script.read(options.script)
    history, body = read_history(options.history), _body(options.run)
    given = {"density": options.density, "tolerance": options.tolerance}
    session = Session(body, **{name: value for name, value in given.items() if value})
    if script is not None:
        frames = script.frames(session)
    else:
        read = options.load, options.forces
        texts = {"nearest": options.nearest, "body_force": options.body_force}
        load = Load.of(body.geometry, command_loads(body.geometry.loaded_body, *read, **texts))
        factor = LoadOverTime.of(history, options.seed)
        frames = under_load(session, load, factor, options.step, options.duration)
    found = Recording.of(body.geometry, frames)
    if options.out.suffix in FILMS:
        from surrogate.figures.motion_film import write_film

        write_film(options.out, body.geometry, found.times, found.displacement)
    else:
        found.save(options.out)
    length, last = body.units.written, found.energies[-1]
    size = abs(found.displacement).max()
    print(
        f"{options.out}: {len(found.times)} steps to {found.times[-1]:.6g} s, largest component "
        f"{length(float(size))}, estimated error of a step up to "
        f"{length(float(found.errors.max()))}, drift of the energy {last[4]:.2g} of "
        f"{found.energies[:, :2].sum(axis=1).max():.2g}"
    )


def _body(path: Path) -> Body:
    """The body of a run, or of a folder of `datagen body`."""
    import surrogate
    from surrogate.mechanics.statics.body import Body

    is_body = path.is_dir() and not (path / "config.yaml").is_file()
    return Body.read(path) if is_body else surrogate.load(path).body
