"""Commands that show what there is: ``datagen check``, ``info``, ``plot``, ``list``, ``schema``."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from shared_schema.common.command_line import Commands, add_command, laid_out
from shared_schema.common.configuration_keys import add_arguments, printed
from shared_schema.common.errors import InputError
from shared_schema.common.files import require_writable
from shared_schema.common.solution_file import require_suffix


def add_check(commands: Commands) -> None:
    """Add ``datagen check``."""
    parser = add_command(
        commands,
        "check",
        "check every byte of a dataset against the schema",
        "datagen check data/beam2d/nodal",
    )
    parser.add_argument("dataset", type=Path, metavar="DIR", help="nodal or structured dataset")
    parser.set_defaults(command=_check)


def _check(options: argparse.Namespace) -> None:
    """Print every violation, or that there is none."""
    from datagen import check
    from shared_schema.dataset_reader import DatasetReader, unstable_samples
    from shared_schema.manifest import find_unfinished, growing

    problems = check(options.dataset)
    if len(problems) == 1:
        raise InputError(problems[0])
    if problems:
        print("\n".join(problems), file=sys.stderr)
        raise InputError(f"{options.dataset}: {len(problems)} violations of the schema")
    growth = find_unfinished(options.dataset)
    rest = "" if growth is None else f"; {growing(growth)}"
    unstable = DatasetReader(options.dataset).unstable()
    if unstable is not None and len(unstable):
        rest = f"; {unstable_samples(unstable)}{rest}"
    print(f"{options.dataset}: intact{rest}")


def add_info(commands: Commands) -> None:
    """Add ``datagen info``."""
    parser = add_command(
        commands,
        "info",
        "summarise a dataset",
        "datagen info data/beam2d/nodal --figure beam2d.png",
    )
    parser.add_argument("dataset", type=Path, metavar="DIR", help="nodal or structured dataset")
    parser.add_argument(
        "--figure", type=Path, metavar="FILE", help="draw the dataset as well, as `plot` does"
    )
    parser.set_defaults(command=_info)


def _info(options: argparse.Namespace) -> None:
    """Print the summary."""
    import datagen

    if options.figure is not None:
        from datagen.output.dataset_figure import SUFFIXES

        require_suffix(options.figure, SUFFIXES, "--figure")
        require_writable(options.figure, "--figure")
        datagen.plot(options.dataset, options.figure)
    print(laid_out(datagen.info(options.dataset).items()))


def add_plot(commands: Commands) -> None:
    """Add ``datagen plot``."""
    parser = add_command(
        commands,
        "plot",
        "draw mesh, groups, supports and some samples of a dataset, a body or a case",
        "datagen plot data/beam2d/nodal --out beam2d.pdf --samples 0,7",
        "datagen plot organ.yaml --out organ.png",
    )
    parser.add_argument(
        "nodal",
        type=Path,
        metavar="NODAL_DIR|CASE",
        help="nodal dataset, as `datagen run` makes it, body, or case",
    )
    parser.add_argument(
        "--out", type=Path, required=True, metavar="FILE.(png|svg|pdf)", help="figure to write"
    )
    parser.add_argument(
        "--samples", metavar="N,N,…", help="sample numbers instead of four chosen by displacement"
    )
    parser.set_defaults(command=_plot)


def _plot(options: argparse.Namespace) -> None:
    """Draw the figure, of a case that of its body."""
    from datagen import body, plot
    from datagen.cases.case import SHIPPED
    from datagen.output.dataset_figure import SUFFIXES

    require_suffix(options.out, SUFFIXES)
    require_writable(options.out)
    with TemporaryDirectory() as folder:
        drawn, is_shipped = options.nodal, (SHIPPED / f"{options.nodal}.yaml").is_file()
        if drawn.is_file() or (is_shipped and not drawn.exists()):
            drawn = Path(folder) / "body"
            body(str(options.nodal), drawn)
        numbers = plot(drawn, options.out, samples=options.samples)
    shown = f"samples {', '.join(str(number) for number in numbers)}" if numbers else "the body"
    print(f"{options.out}: {shown}")


def add_list(commands: Commands) -> None:
    """Add ``datagen list``."""
    parser = add_command(
        commands,
        "list",
        "list the cases that come with the package",
        "datagen list",
    )
    parser.set_defaults(command=_list)


def _list(options: argparse.Namespace) -> None:
    """Print a line for each case."""
    from datagen import shipped_cases
    from shared_schema.common.command_line import laid_out

    rows = [[str(value) for value in case] for case in shipped_cases()]
    print(laid_out([("case", "mesh", "load", "samples", ""), *rows]))


def add_schema(commands: Commands) -> None:
    """Add ``datagen schema``."""
    parser = add_command(
        commands,
        "schema",
        "print the keys of a case file",
        "datagen schema load",
        "datagen schema --format json > case.schema.json",
    )
    add_arguments(parser)
    parser.set_defaults(command=_schema)


def _schema(options: argparse.Namespace) -> None:
    """Print the keys; behind all of them, what the units are."""
    from datagen import case_keys, case_schema
    from shared_schema.common.units import GUIDANCE

    print(printed(options, case_keys(), case_schema()))
    if options.format == "text" and not options.key:
        print(f"\n{GUIDANCE}", end="")
