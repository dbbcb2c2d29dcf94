"""surrogate evaluate: measure a run on the test split and draw its figures."""

from __future__ import annotations

import argparse
from pathlib import Path

from shared_schema.common.command_line import Commands, add_command
from surrogate.commands.options import RUN, add_device, add_passes, given_passes


def add_to(commands: Commands) -> None:
    """Add the command's parser."""
    parser = add_command(
        commands,
        "evaluate",
        "measure a run on the test split, draw figures",
        "surrogate evaluate runs/beam2d --data data/beam2d/structured",
    )
    parser.add_argument("run", type=Path, metavar="RUN", help=RUN)
    parser.add_argument(
        "--data",
        type=Path,
        required=True,
        metavar="DIR",
        help="structured dataset; its test split is used",
    )
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
    """Evaluate, and print the errors."""
    from surrogate.device import choose_device
    from surrogate.evaluation.evaluate import evaluate
    from surrogate.evaluation.published import Published, read_published
    from surrogate.figures.run_figures import write_evaluation
    from surrogate.runs.folder import RunFolder
    from surrogate.runs.shelf import copy_run, find_run, require_changeable

    device = choose_device(options.device).type
    require_changeable(options.run, options.out)
    published = read_published(options.beside) if options.beside else Published()
    evaluation = evaluate(
        options.run,
        options.data,
        device,
        loads=options.loads,
        conformal=options.conformal,
        certify=options.certify,
        example_displacement=published.example_displacement,
        **given_passes(options),
    )
    run = find_run(options.run)
    if options.out is not None:
        run = copy_run(run, options.out)
    write_evaluation(evaluation, RunFolder(run))
    measures, calibration = evaluation.measures, evaluation.calibration
    print(
        f"{run}: {measures.samples} test samples, mean error {measures.mean_error:.3e} m "
        f"({measures.relative_error_mean:.2%} of the largest displacement), "
        f"standard deviation {measures.std_error:.3e} m, largest {measures.max_error:.3e} m"
    )
    if evaluation.stress is not None:
        print(
            f"{run}: von Mises stress, mean error {evaluation.stress.mean_error:.3e} Pa "
            f"({evaluation.stress.relative_error:.2%} of the largest)"
        )
    if calibration is not None:
        shares = ", ".join(f"{i.coverage:.1%} of {i.level:.0%}" for i in calibration.intervals)
        print(
            f"{run}: mean predicted standard deviation {calibration.mean_std:.3e} m, "
            f"intervals cover {shares}"
        )
    if (certified := evaluation.content.get("fast_certificate")) and certified["mean"]:
        shares = ", ".join(f"{b['coverage']:.1%} of {b['level']:.0%}" for b in certified["mean"])
        wide = certified["mean"][-1]["median_width"]
        print(f"{run}: fast bounds cover {shares}, in the median {wide:.2g} times the error")
        if of_components := certified.get("component"):
            shares = ", ".join(f"{b['coverage']:.1%} of {b['level']:.0%}" for b in of_components)
            print(f"{run}: intervals of its size cover {shares} of the components")
