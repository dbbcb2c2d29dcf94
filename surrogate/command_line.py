"""The command ``surrogate``: train, evaluate, predict, report."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

from shared_schema.command_line import run_command


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; return its exit code (0 done, 1 failed, 2 wrong input)."""
    options = _parser().parse_args(arguments)
    command: Callable[[argparse.Namespace], None] = options.command
    speaks = os.environ.get("RANK", "0") == "0"  # torchrun's
    return run_command("surrogate", lambda: command(options), speaks)


def _parser() -> argparse.ArgumentParser:
    from surrogate import __version__

    parser = argparse.ArgumentParser(
        prog="surrogate",
        description="Train and judge U-Net surrogates on datasets made by datagen.",
        epilog="Exit codes: 0 done, 1 the work failed, 2 the input is wrong.",
    )
    parser.add_argument("--version", action="version", version=f"surrogate {__version__}")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")

    train = commands.add_parser("train", help="train a network, or go on from its checkpoint")
    train.add_argument("config", metavar="CONFIG", help="YAML file, or the name of a shipped one")
    train.add_argument("--data", type=Path, required=True, metavar="DIR", help="structured dataset")
    train.add_argument("--out", type=Path, required=True, metavar="RUN", help="run folder")
    train.add_argument("--device", choices=("auto", "cpu", "cuda"), default="auto")
    train.add_argument(
        "--stop-after",
        type=int,
        metavar="EPOCH",
        help="stop there, with a checkpoint to go on from",
    )
    train.add_argument(
        "--tensorboard", action="store_true", help="write TensorBoard's files into the run folder"
    )
    train.set_defaults(command=_train)

    evaluate = commands.add_parser("evaluate", help="measure a run on the test split, draw figures")
    evaluate.add_argument("run", type=Path, metavar="RUN")
    evaluate.add_argument("--data", type=Path, required=True, metavar="DIR")
    evaluate.add_argument("--device", choices=("auto", "cpu", "cuda"), default="auto")
    evaluate.set_defaults(command=_evaluate)

    predict = commands.add_parser("predict", help="predict one load case and write the fields")
    predict.add_argument("run", type=Path, metavar="RUN")
    predict.add_argument(
        "--load", action="append", required=True, metavar="X,Y[,Z]:FX,FY[,FZ]", help="repeatable"
    )
    predict.add_argument("--out", type=Path, required=True, metavar="FILE.(npz|vtu|xdmf)")
    predict.set_defaults(command=_predict)

    report = commands.add_parser("report", help="write a run's results as one HTML page")
    report.add_argument("run", type=Path, metavar="RUN", help="an evaluated run")
    report.add_argument(
        "--nodal", type=Path, metavar="DIR", help="the nodal dataset, for its times"
    )
    report.add_argument("--out", type=Path, required=True, metavar="FILE.html")
    report.set_defaults(command=_report)
    return parser


def _train(options: argparse.Namespace) -> None:
    from surrogate.data_parallel import joined
    from surrogate.dataset import read_dataset
    from surrogate.run_config import read_config
    from surrogate.run_folder import RunFolder
    from surrogate.training import train

    config = read_config(options.config)
    run = RunFolder(options.out)
    with joined(options.device) as (ranks, device):
        dataset = read_dataset(options.data)
        train(config, dataset, run, device, options.stop_after, ranks, options.tensorboard)
    if not ranks.is_first:
        return
    lines = run.metric_lines()
    last = lines[-1] if lines else {"epoch": 0, "seconds": 0.0}
    state = "trained" if run.model.is_file() else "stopped, to be gone on with"
    print(
        f"{options.out}: {state}, {last['epoch']} of {config.training.epochs} epochs, "
        f"{last['seconds']:.0f} s"
    )


def _evaluate(options: argparse.Namespace) -> None:
    from surrogate.device import choose_device
    from surrogate.evaluation import evaluate

    measures = evaluate(options.run, options.data, choose_device(options.device).type).measures
    print(
        f"{options.run}: {measures.samples} test samples, mean error {measures.mean_error:.3e} m, "
        f"standard deviation {measures.std_error:.3e} m, largest {measures.max_error:.3e} m"
    )


def _predict(options: argparse.Namespace) -> None:
    from shared_schema.point_load import nodal_forces
    from shared_schema.solution_file import require_suffix, write_solution
    from surrogate.prediction import load

    require_suffix(options.out)
    surrogate = load(options.run)
    geometry = surrogate.geometry
    forces = nodal_forces(options.load, geometry.coordinates, geometry.clamped)
    warning = surrogate.outside_training(forces)
    if warning:
        print(f"surrogate: warning: {warning}", file=sys.stderr)
    write_solution(
        options.out,
        geometry.coordinates,
        geometry.cells,
        geometry.cell_type,
        {"force": forces, "displacement": surrogate.predict(forces)},
    )
    print(f"{options.out}: predicted")


def _report(options: argparse.Namespace) -> None:
    from surrogate.report import write_report

    write_report(options.run, options.nodal, options.out)
    print(options.out.resolve())


if __name__ == "__main__":
    sys.exit(main())
