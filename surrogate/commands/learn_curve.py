"""surrogate learn-curve: the error over the number of training samples, on own data."""

from __future__ import annotations

import argparse
from math import isfinite
from pathlib import Path

from shared_schema.common.atomic_file import require_writable, write_text
from shared_schema.common.command_line import Commands, add_command, add_set
from surrogate.commands.options import add_device, positive

FAR = 4  # ratio of samples beyond which the fit is a guess


def add_to(commands: Commands) -> None:
    """Add the command's parser."""
    parser = add_command(
        commands,
        "learn-curve",
        "train on growing numbers of samples, and say how many an error needs",
        "surrogate learn-curve beam2d_any-det-fast --data data/beam2d_any/structured "
        "--samples 500,1000,2000 --goal 1e-4 --out runs/curve",
    )
    parser.add_argument("config", metavar="CONFIG", help="YAML file, or the name of a recipe")
    parser.add_argument(
        "--data", type=Path, required=True, metavar="DIR", help="structured dataset"
    )
    parser.add_argument(
        "--out", type=Path, required=True, metavar="DIR", help="folder of runs, table and figure"
    )
    parser.add_argument(
        "--samples",
        type=counts,
        default=(),
        metavar="N,N,…",
        help="numbers of training samples (default: all, and halves of them); every training has "
        "as many steps as that on all samples",
    )
    parser.add_argument(
        "--goal", type=positive, metavar="M", help="mean error in m whose number of samples is told"
    )
    add_set(parser, "the configuration", "training.epochs=20")
    add_device(parser)
    parser.set_defaults(command=run)


def counts(text: str) -> tuple[int, ...]:
    """Read numbers of samples; ArgumentTypeError if they are none."""
    try:
        return tuple(int(count) for count in text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"'{text}': expected numbers such as 100,200") from None


def run(options: argparse.Namespace) -> None:
    """Train and evaluate; print the curve; write table and figure."""
    from shared_schema.common.drawing.figure_style import save
    from shared_schema.common.text_table import laid_out
    from surrogate.device import choose_device
    from surrogate.evaluation.learning_curve import PowerLaw, curve_as_json, learning_curve
    from surrogate.figures.learning_curve_figure import learning_curve_figure
    from surrogate.runs.run_config import read_config

    config = read_config(options.config, changes=options.changes, data=options.data)
    out = options.out
    require_writable(out)
    device = choose_device(options.device)
    points = learning_curve(config, options.data, out, options.samples, device)
    law = PowerLaw.of(points) if len(points) > 1 else None
    write_text(out / "learning-curve.json", curve_as_json(config, points, law))
    save(learning_curve_figure(points, law), out / "learning-curve.png")
    rows: list[tuple[str, ...]] = [("samples", "ē", "σ(e)", "training")]
    for point in points:
        errors = (f"{error:.2e} m" for error in (point.mean_error, point.std_error))
        rows.append((str(point.samples), *errors, f"{point.minutes:.3g} min"))
    print(laid_out(rows))
    if law is not None:
        most = points[-1].samples
        print(
            f"fitted: ē falls as N^{-law.exponent:.2f}; {2 * most} samples would have "
            f"{law.error(2 * most):.2e} m"
        )
        if options.goal is not None:
            needed = law.samples(options.goal)
            told = f"about {needed:.3g} training samples" if isfinite(needed) else "other means"
            far = ", far beyond those that were tried" if needed > FAR * most else ""
            print(f"ē = {options.goal:.2e} m needs {told}{far}")
