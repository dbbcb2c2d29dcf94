"""surrogate init: write a first configuration for a dataset."""

from __future__ import annotations

import argparse
from pathlib import Path

from shared_schema.common.command_line import Commands, add_command
from shared_schema.common.files import require_writable, write_text

LIKELIHOODS = ("deterministic", "maximum_likelihood", "variational_bayes")


def add_to(commands: Commands) -> None:
    """Add the command's parser."""
    parser = add_command(
        commands,
        "init",
        "write a first configuration for a dataset, with a comment on every line",
        "surrogate init data/finger/structured --out finger.yaml",
        "surrogate init beam2d --likelihood maximum_likelihood --out beam2d.yaml",
    )
    parser.add_argument(
        "target",
        metavar="CASE|DATA",
        help="structured dataset, or a case (name or YAML file) whose dataset is at "
        "data/CASE/structured",
    )
    parser.add_argument(
        "--out", type=Path, required=True, metavar="FILE.yaml", help="configuration to write"
    )
    parser.add_argument(
        "--model",
        choices=("unet", "reduced"),
        help="kind of network (default: unet on a grid in the plane, else reduced)",
    )
    parser.add_argument(
        "--likelihood",
        choices=LIKELIHOODS,
        default=LIKELIHOODS[0],
        help="deterministic (default), or with standard deviations",
    )
    parser.set_defaults(command=run)


def run(options: argparse.Namespace) -> None:
    """Write the file, and say what is next."""
    import surrogate
    from shared_schema.common.errors import InputError
    from shared_schema.common.solution_file import require_suffix
    from surrogate.learning.planning.first_configuration import find_data

    require_suffix(options.out, (".yaml",))
    require_writable(options.out)
    if options.out.exists():
        raise InputError(f"--out '{options.out}': exists, expected a new file")
    data = find_data(options.target)
    first = surrogate.first_config(data, model=options.model, likelihood=options.likelihood)
    config = first.config()
    write_text(options.out, first.text())
    print(
        f"{options.out}: {config.architecture}; next: surrogate train {options.out} --data {data} "
        f"--out runs/{config.name} (with --dry-run it says what that takes)"
    )
