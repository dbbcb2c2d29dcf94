"""The command ``surrogate``: train, evaluate, predict, export, report, list, shelve, studies."""

from __future__ import annotations

import argparse
import math
import os
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from shared_schema.common.atomic_file import require_writable
from shared_schema.common.command_line import make_parser, run_command

if TYPE_CHECKING:
    from surrogate.studies.framework.studies_report import Report
    from surrogate.studies.framework.study import Study


RUN = "run folder, or a trained network of the package (surrogate list)"


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; return its exit code (0 done, 1 failed, 2 wrong input, 3 not certified)."""
    options = _parser().parse_args(arguments)
    command: Callable[[argparse.Namespace], None] = options.command
    speaks = os.environ.get("RANK", "0") == "0"  # set by torchrun

    def run() -> None:
        from surrogate.hardware import memory_errors

        with memory_errors():
            command(options)

    return run_command("surrogate", run, speaks)


def _parser() -> argparse.ArgumentParser:
    from surrogate import __version__

    description = "Train and evaluate surrogates on datasets made by datagen."
    parser, commands = make_parser("surrogate", description, __version__)

    train = commands.add_parser("train", help="train a network, or resume from its checkpoint")
    train.add_argument("config", metavar="CONFIG", help="YAML file, or the name of a shipped one")
    train.add_argument("--data", type=Path, required=True, metavar="DIR", help="structured dataset")
    train.add_argument("--out", type=Path, required=True, metavar="RUN", help="run folder")
    train.add_argument("--device", choices=("auto", "cpu", "cuda"), default="auto")
    train.add_argument(
        "--stop-after",
        type=int,
        metavar="EPOCH",
        help="stop after this epoch, with a checkpoint to resume from",
    )
    train.add_argument(
        "--seconds",
        type=float,
        default=math.inf,
        metavar="S",
        help="begin no epoch after this time, and write a checkpoint to resume from",
    )
    train.add_argument(
        "--tensorboard", action="store_true", help="write TensorBoard's files into the run folder"
    )
    train.add_argument(
        "--start-from",
        type=Path,
        metavar="RUN",
        help="start from the weights of another run on the same body, on any dataset of it",
    )
    train.set_defaults(command=_train)

    evaluate = commands.add_parser("evaluate", help="measure a run on the test split, draw figures")
    evaluate.add_argument("run", type=Path, metavar="RUN", help=RUN)
    evaluate.add_argument("--data", type=Path, required=True, metavar="DIR")
    evaluate.add_argument("--device", choices=("auto", "cpu", "cuda"), default="auto")
    _add_passes(evaluate, "number of passes of a stochastic network (default 300)")
    evaluate.add_argument(
        "--loads",
        type=Path,
        metavar="NODAL_DIR",
        help="also predict the samples of this nodal dataset (other loads on the same body)",
    )
    evaluate.add_argument(
        "--conformal",
        type=float,
        metavar="LEVEL",
        help="fit conformal intervals to the run's calibration samples, and measure them",
    )
    evaluate.add_argument(
        "--out", type=Path, metavar="DIR", help="write into a new copy of the run, not into it"
    )
    evaluate.set_defaults(command=_evaluate)

    predict = commands.add_parser("predict", help="predict one load case and write the fields")
    predict.add_argument("run", type=Path, metavar="RUN", help=RUN)
    predict.add_argument(
        "--load", action="append", required=True, metavar="X,Y[,Z]:FX,FY[,FZ]", help="repeatable"
    )
    predict.add_argument("--out", type=Path, required=True, metavar="FILE.(npz|vtu|xdmf)")
    _add_passes(predict, "number of passes of a stochastic network (default 300)")
    predict.add_argument("--device", choices=("auto", "cpu", "cuda"), default="auto")
    predict.add_argument(
        "--conformal",
        choices=("marginal", "simultaneous"),
        help="add the bounds of the run's conformal intervals: 'lower' and 'upper'",
    )
    predict.add_argument(
        "--certify", action="store_true", help="estimate the error; add it as 'estimated_error'"
    )
    predict.add_argument(
        "--tolerance",
        type=_positive,
        metavar="M",
        help="with --certify: largest estimated error of a node in m, else exit code 3",
    )
    predict.add_argument(
        "--correct",
        action="store_true",
        help="go on to the finite elements' equilibrium; add the network's as 'predicted'",
    )
    predict.set_defaults(command=_predict)

    export = commands.add_parser(
        "export", help="write the network as a file that needs no code of this project"
    )
    export.add_argument("run", type=Path, metavar="RUN", help=RUN)
    export.add_argument("--format", choices=("onnx", "pt2"), required=True)
    export.add_argument("--out", type=Path, required=True, metavar="FILE.(onnx|pt2)")
    _add_passes(export, "number of passes in the file (default: mean weights, without passes)")
    export.set_defaults(command=_export)

    report = commands.add_parser("report", help="write a run's results as one HTML page")
    report.add_argument("run", type=Path, metavar="RUN", help=f"an evaluated {RUN}")
    report.add_argument(
        "--nodal", type=Path, metavar="DIR", help="nodal dataset; the page shows its solve times"
    )
    report.add_argument("--out", type=Path, required=True, metavar="FILE.html")
    report.set_defaults(command=_report)

    listed = commands.add_parser("list", help="list the trained networks of the package")
    listed.set_defaults(command=_list)

    shelve = commands.add_parser(
        "shelve", help="put a run among the trained networks of the package"
    )
    shelve.add_argument("run", type=Path, metavar="RUN", help="an evaluated run folder")
    shelve.add_argument("name", metavar="NAME", help="name of the network, such as its case")
    shelve.set_defaults(command=_shelve)

    study = commands.add_parser("study", help="do some studies of one of the two reports")
    study.add_argument("names", nargs="+", metavar="NAME", help="study, such as force-sweep-beam")
    _add_studies(study)
    study.add_argument("--again", action="store_true", help="repeat studies that are up to date")
    study.set_defaults(command=_study)

    for name, command, what in (
        ("reproduce", _reproduce, "make all of the paper's tables and figures"),
        ("beyond", _beyond, "do all studies beyond the paper"),
    ):
        whole = commands.add_parser(name, help=what)
        _add_studies(whole)
        whole.add_argument(
            "--list-data", action="store_true", help="print the commands that make missing datasets"
        )
        whole.set_defaults(command=command)
    return parser


def _add_studies(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--scale",
        default="laptop",
        metavar="NAME",
        help="smoke, laptop, paper (reproduction) or day (beyond), or a YAML file",
    )
    parser.add_argument("--data", type=Path, default=Path("data"), metavar="DIR", help="datasets")
    parser.add_argument("--runs", type=Path, default=Path("runs"), metavar="DIR", help="networks")
    parser.add_argument(
        "--out",
        type=Path,
        metavar="DIR",
        help="report (default docs/reproduction/SCALE or docs/beyond/SCALE)",
    )
    parser.add_argument("--device", choices=("auto", "cpu", "cuda"), default="auto")


def _add_passes(parser: argparse.ArgumentParser, what: str) -> None:
    parser.add_argument("--passes", type=int, metavar="T", help=what)
    parser.add_argument("--seed", type=int, metavar="S", help="seed of the passes (default 0)")


def _passes(options: argparse.Namespace) -> dict[str, int]:
    """Return the given options among --passes and --seed."""
    given = {"passes": options.passes, "seed": options.seed}
    return {name: value for name, value in given.items() if value is not None}


def _remark_unsealed(folder: Path) -> None:
    """Warn if a run folder has no manifest."""
    from surrogate.runs.folder import RunFolder
    from surrogate.runs.shelf import find_run

    remark = RunFolder(find_run(folder)).unsealed
    if remark:
        print(f"surrogate: warning: {remark}", file=sys.stderr)


def _positive(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if not 0 < value < float("inf"):
        raise argparse.ArgumentTypeError(f"'{text}': expected a positive number")
    return value


def _train(options: argparse.Namespace) -> None:
    from surrogate.data.dataset import read_dataset
    from surrogate.models.model import TrainedModel
    from surrogate.runs.configuration import read_config
    from surrogate.runs.folder import RunFolder
    from surrogate.training.data_parallel import joined
    from surrogate.training.train import stays_on_disk, train

    config = read_config(options.config)
    run = RunFolder(options.out)
    require_writable(run.folder)
    with joined(options.device) as (ranks, device):
        dataset = read_dataset(options.data, on_disk=stays_on_disk(config))
        train(
            config,
            dataset,
            run,
            device,
            options.stop_after,
            ranks,
            options.tensorboard,
            options.seconds,
            options.start_from,
        )
    if not ranks.is_first:
        return
    lines = run.metric_lines()
    last = lines[-1] if lines else {"epoch": 0, "seconds": 0.0}
    _remark_unsealed(run.folder)
    state = "trained" if run.is_finished else "stopped; resume with the same command"
    epochs = ""
    if isinstance(config, TrainedModel):
        epochs = f"{last['epoch']} of {config.training.epochs} epochs, "
    print(f"{options.out}: {state}, {epochs}{last['seconds']:.0f} s")


def _evaluate(options: argparse.Namespace) -> None:
    from surrogate.device import choose_device
    from surrogate.evaluation.evaluate import evaluate
    from surrogate.presentation.run_figures import write_evaluation
    from surrogate.runs.folder import RunFolder
    from surrogate.runs.shelf import copy_run, find_run, require_changeable

    device = choose_device(options.device).type
    require_changeable(options.run, options.out)
    _remark_unsealed(options.run)
    evaluation = evaluate(
        options.run,
        options.data,
        device,
        loads=options.loads,
        conformal=options.conformal,
        **_passes(options),
    )
    run = find_run(options.run)
    if options.out is not None:
        run = copy_run(run, options.out)
    write_evaluation(evaluation, RunFolder(run))
    measures, calibration = evaluation.measures, evaluation.calibration
    print(
        f"{run}: {measures.samples} test samples, mean error {measures.mean_error:.3e} m, "
        f"standard deviation {measures.std_error:.3e} m, largest {measures.max_error:.3e} m"
    )
    if calibration is not None:
        shares = ", ".join(f"{i.coverage:.1%} of {i.level:.0%}" for i in calibration.intervals)
        print(
            f"{run}: mean predicted standard deviation {calibration.mean_std:.3e} m, "
            f"intervals cover {shares}"
        )


def _predict(options: argparse.Namespace) -> None:
    from shared_schema.common.errors import InputError, NotCertifiedError
    from shared_schema.common.point_load import nodal_forces
    from shared_schema.common.solution_file import require_suffix, write_solution
    from surrogate.device import choose_device
    from surrogate.inference.prediction import load
    from surrogate.runs.folder import RunFolder
    from surrogate.runs.shelf import find_run
    from surrogate.uncertainty.intervals import load_intervals

    require_suffix(options.out)
    require_writable(options.out)
    if options.tolerance is not None and not options.certify:
        raise InputError(f"--tolerance {options.tolerance}: expected beside --certify")
    _remark_unsealed(options.run)
    intervals = None
    if options.conformal:
        run = RunFolder(find_run(options.run))
        run.seal.require_intact(run.intervals)
        intervals = load_intervals(run.intervals)
    surrogate = load(options.run, choose_device(options.device).type)
    surrogate.require_stochastic(**_passes(options))
    geometry = surrogate.geometry
    forces = nodal_forces(options.load, geometry.coordinates, geometry.clamped)
    predicted = surrogate.predict_distribution(forces, **_passes(options))
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
        certificate = surrogate.certify(forces, fields["displacement"])
        fields["estimated_error"] = certificate.error
        notes.append(certificate.summary())
        if options.tolerance is not None:
            refusal = certificate.refusal(options.tolerance)
            notes.append("certified" if refusal is None else "not certified")
    write_solution(
        options.out,
        geometry.coordinates,
        geometry.cells,
        geometry.cell_type,
        {"force": forces, **fields},
    )
    print(f"{options.out}: {', '.join(notes)}")
    if refusal is not None:
        raise NotCertifiedError(refusal)


def _export(options: argparse.Namespace) -> None:
    from surrogate.inference.export import export

    require_writable(options.out)
    _remark_unsealed(options.run)
    difference = export(options.run, options.format, options.out, **_passes(options))
    print(f"{options.out}: exported, differs from the network by {difference:.1e} relatively")


def _report(options: argparse.Namespace) -> None:
    from surrogate.presentation.report import write_report

    require_writable(options.out)
    _remark_unsealed(options.run)
    write_report(options.run, options.nodal, options.out)
    print(options.out.resolve())


def _list(options: argparse.Namespace) -> None:
    from surrogate.presentation.trained_list import trained_list

    print(trained_list())


def _shelve(options: argparse.Namespace) -> None:
    from surrogate.runs.shelf import shelve, size_of

    folder = shelve(options.run, options.name)
    print(f"{folder}: {size_of(folder) / 1e6:.1f} MB")


def _study(options: argparse.Namespace) -> None:
    from surrogate.studies.reproduction import find_report, find_studies

    _do(options, find_report(options.names), find_studies(options.names), options.again)


def _reproduce(options: argparse.Namespace) -> None:
    from surrogate.studies.catalogue import REPRODUCTION

    _do_all(options, REPRODUCTION)


def _beyond(options: argparse.Namespace) -> None:
    from surrogate.studies.beyond.catalogue import BEYOND

    _do_all(options, BEYOND)


def _do_all(options: argparse.Namespace, report: Report) -> None:
    from surrogate.studies.framework.data_commands import missing_data
    from surrogate.studies.framework.scale import read_scale

    if options.list_data:
        for line in missing_data(read_scale(options.scale, report.scales), options.data):
            print(line)
    else:
        _do(options, report, report.studies)


def _do(
    options: argparse.Namespace, report: Report, studies: Sequence[Study], again: bool = False
) -> None:
    from surrogate.device import choose_device
    from surrogate.studies.framework.resources import Resources
    from surrogate.studies.framework.scale import read_scale
    from surrogate.studies.framework.studies_report import PAGE
    from surrogate.studies.reproduction import reproduce

    scale, device = read_scale(options.scale, report.scales), choose_device(options.device)
    out = options.out or Path("docs", report.name, scale.name)
    require_writable(out)
    require_writable(options.runs, "--runs")
    resources = Resources(scale, options.data, options.runs, device)
    done = reproduce(studies, resources, out, again, report)
    state = f"{done} done now, " if done else ""
    print(f"{out / PAGE}: {state}{len(studies) - done} of {len(studies)} studies up to date")


if __name__ == "__main__":
    code = main()
    if "TORCHELASTIC_RUN_ID" in os.environ:  # set by torchrun
        # exit without the interpreter's cleanup: a thread of torch could abort the process in it
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)
    sys.exit(code)
