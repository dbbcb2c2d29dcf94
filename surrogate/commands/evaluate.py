"""surrogate evaluate: measure a run on the test split and draw its figures."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

from shared_schema.common.command_line import Commands, add_command
from shared_schema.common.files import write_text
from surrogate.command_options import RUN, add_data, add_device, add_passes, given_passes


def add_to(commands: Commands) -> None:
    """Add the command's parser."""
    parser = add_command(
        commands,
        "evaluate",
        "measure a run on the test split, draw figures",
        "surrogate evaluate runs/beam2d --data data/beam2d/structured",
    )
    parser.add_argument("run", type=Path, metavar="RUN", help=f"{RUN}, or a folder of seeds")
    add_data(parser, "structured dataset; its test split is used")
    add_device(parser)
    add_passes(parser, "number of passes of a stochastic network (default 300)")
    parser.add_argument(
        "--loads",
        type=Path,
        metavar="NODAL_DIR",
        help="also predict the samples of this nodal dataset (other loads on the same body)",
    )
    parser.add_argument(
        "--conformal",
        type=float,
        metavar="LEVEL",
        help="fit conformal intervals to the run's calibration samples, and measure them",
    )
    parser.add_argument(
        "--certify",
        action="store_true",
        help="calibrate the fast certificate on the run's held-out samples, and measure it",
    )
    parser.add_argument(
        "--beside",
        type=Path,
        metavar="FILE.yaml",
        help="published numbers; the sample that is shown is the one nearest to the published",
    )
    parser.add_argument(
        "--out", type=Path, metavar="DIR", help="write into a new copy of the run, not into it"
    )
    parser.set_defaults(command=run)


def run(options: argparse.Namespace) -> None:
    """Evaluate, write, and print the errors; of several seeds, also how they spread."""
    from surrogate.learning.evaluation.seeds import lines_of, runs_of_seeds, spread
    from surrogate.learning.runs.folder import RunFolder

    runs = runs_of_seeds(options.run)
    if not runs:
        evaluate(options, options.run, options.out)
        return
    into = options.out or options.run
    found = spread([evaluate(options, run, options.out and into / run.name) for run in runs])
    write_text(into / "seeds.json", json.dumps(found, indent=1) + "\n")
    for line in lines_of(found, RunFolder(runs[0]).description().data.units.length):
        print(f"{into}: {line}")


def evaluate(options: argparse.Namespace, run: Path, out: Path | None) -> dict[str, Any]:
    """Evaluate and write one run, print its errors, and return its measures."""
    import surrogate
    from surrogate.learning.runs.shelf import require_changeable

    require_changeable(run, out)
    published = surrogate.read_published(options.beside) if options.beside else None
    evaluation = surrogate.evaluate(
        run,
        options.data,
        device=options.device,
        loads=options.loads,
        conformal=options.conformal,
        certify=options.certify,
        example_displacement=published.example_displacement if published else None,
        **given_passes(options),
    )
    folder = evaluation.write(out)
    for line in evaluation.lines():
        print(f"{folder}: {line}", flush=True)
    return evaluation.content
