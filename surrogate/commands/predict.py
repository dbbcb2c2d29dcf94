"""surrogate predict: predict one load case; certify or correct it; write the fields."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from shared_schema.common.atomic_file import require_writable
from shared_schema.common.bodies.load_options import STRESSES, add_loads
from shared_schema.common.command_line import Commands, add_command
from surrogate.commands.options import (
    RUN,
    add_device,
    add_passes,
    given_passes,
    positive,
    share,
    warn_unsealed,
)

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from surrogate.certify.certificate import Certificate
    from surrogate.certify.fast_certificate import Bounds, FastCertificate
    from surrogate.inference.prediction import Surrogate

    Array = NDArray[np.float64]


def add_to(commands: Commands) -> None:
    """Add the command's parser."""
    parser = add_command(
        commands,
        "predict",
        "predict one load case and write the fields",
        "surrogate predict beam2d_any --load 4,1:0,-1.5 --certify --out prediction.vtu",
    )
    parser.add_argument("run", type=Path, metavar="RUN", help=RUN)
    add_loads(parser)
    parser.add_argument("--stresses", action="store_true", help=STRESSES)
    parser.add_argument(
        "--out",
        type=Path,
        required=True,
        metavar="FILE.(npz|vtu|xdmf)",
        help="fields at the nodes: force, displacement, standard deviations",
    )
    add_passes(parser, "number of passes of a stochastic network (default 300)")
    add_device(parser)
    parser.add_argument(
        "--conformal",
        choices=("marginal", "simultaneous"),
        help="add the bounds of the run's conformal intervals: 'lower' and 'upper'",
    )
    parser.add_argument(
        "--certify",
        nargs="?",
        const="full",
        choices=("full", "fast"),
        help="estimate the error; add it as 'estimated_error'; 'fast' in real time, with bounds, "
        "also of every component if the network predicts standard deviations: 'half_width'",
    )
    parser.add_argument(
        "--level", type=share, metavar="P", help="probability of the fast bounds (default 0.95)"
    )
    parser.add_argument(
        "--tolerance",
        type=positive,
        metavar="M",
        help="with --certify: largest error of a node in m (estimate, or fast bound), else exit "
        "code 3",
    )
    parser.add_argument(
        "--correct",
        action="store_true",
        help="go on to the finite elements' equilibrium; add the network's as 'predicted'",
    )
    parser.set_defaults(command=run)


def run(options: argparse.Namespace) -> None:
    """Predict, and write the fields."""
    from shared_schema.common.bodies.command_loads import command_loads
    from shared_schema.common.errors import InputError, NotCertifiedError
    from shared_schema.common.solution_file import require_suffix, write_solution
    from surrogate.certify.intervals import load_intervals
    from surrogate.device import choose_device
    from surrogate.inference.loading import load
    from surrogate.inference.prediction import require_known_pressure
    from surrogate.runs.folder import RunFolder
    from surrogate.runs.shelf import find_run

    require_suffix(options.out)
    require_writable(options.out)
    if options.tolerance is not None and not options.certify:
        raise InputError(f"--tolerance {options.tolerance}: expected beside --certify")
    if options.level is not None and options.certify != "fast":
        raise InputError(f"--level {options.level}: expected beside --certify fast")
    if options.correct and options.certify == "fast":
        raise InputError("--certify fast: bounds predictions, expected 'full' beside --correct")
    warn_unsealed(options.run)
    intervals = None
    if options.conformal:
        run = RunFolder(find_run(options.run))
        run.seal.require_intact(run.intervals)
        intervals = load_intervals(run.intervals)
    surrogate = load(options.run, choose_device(options.device).type)
    level = options.level or 0.95
    fast = _fast_certificate(options.run, surrogate, level) if options.certify == "fast" else None
    surrogate.require_stochastic(**given_passes(options))
    geometry = surrogate.geometry
    body = geometry.loaded_body
    given = command_loads(body, options.load, options.forces, nearest=options.nearest)
    require_known_pressure(geometry, given)
    forces = given.at_rest
    for note in given.notes:
        print(note)
    predicted = surrogate.predict_distribution(forces, **given_passes(options))
    fields = predicted.fields() if surrogate.is_probabilistic else {"displacement": predicted.mean}
    if intervals is not None:
        ends = intervals.bounds(options.conformal, surrogate, predicted)
        fields |= dict(zip(("lower", "upper"), ends, strict=True))
    for warning in surrogate.training_range.exceeded(forces).values():
        print(f"surrogate: warning: {warning}", file=sys.stderr)
    notes, refusal = ["predicted"], None
    if options.correct:
        correction = surrogate.correct(forces, predicted.mean)
        fields = {"displacement": correction.displacement, "predicted": predicted.mean}
        notes.append(correction.summary())
    if options.certify:
        displacement = fields["displacement"]
        certificate: Certificate | Bounds
        if fast is None:
            certificate = surrogate.certify(forces, displacement)
        else:
            certificate = fast.certify(forces, displacement, level)
        fields["estimated_error"] = certificate.error
        if fast is not None and fast.knows_components:
            error, std = certificate.error[None], predicted.std[None]
            fields["half_width"] = fast.half_widths(error, std, level)[0]
        notes.append(certificate.summary())
        if options.tolerance is not None:
            refusal = certificate.refusal(options.tolerance)
            notes.append("certified" if refusal is None else "not certified")
    of_cells: dict[str, Array] = {}
    if options.stresses:
        of_cells = surrogate.stresses(fields["displacement"])
        pushed = given.pushed(fields["displacement"])
        fields["reaction"] = surrogate.reactions(fields["displacement"], pushed)
        largest = of_cells["von_mises"][of_cells["jacobian"] > 0].max(initial=0.0)
        notes.append(f"largest von Mises stress {largest:.4g} Pa")
    mesh = geometry.coordinates, geometry.cells, geometry.cell_type
    write_solution(options.out, *mesh, {"force": forces, **fields}, of_cells)
    print(f"{options.out}: {', '.join(notes)}")
    if refusal is not None:
        raise NotCertifiedError(refusal)


def _fast_certificate(run: Path, surrogate: Surrogate, level: float) -> FastCertificate:
    """Read the fast certificate of a run, and check that it has the level."""
    from shared_schema.common.errors import InputError
    from surrogate.certify.fast_certificate import load_fast_certificate
    from surrogate.runs.folder import RunFolder
    from surrogate.runs.shelf import find_run

    folder = RunFolder(find_run(run))
    folder.seal.require_intact(folder.fast_certificate)
    fast = load_fast_certificate(surrogate, folder.fast_certificate)
    try:
        fast.factor(level)
    except ValueError as error:
        raise InputError(f"--level {level:g}: {error}") from None
    return fast
