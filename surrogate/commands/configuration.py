"""surrogate init and schema: a first configuration for one's own body, and all keys there are."""

from __future__ import annotations

import argparse
from pathlib import Path

from shared_schema.common.atomic_file import require_writable, write_text
from shared_schema.common.command_line import Commands, add_command
from shared_schema.common.keys.schema_command import add_arguments, printed

LIKELIHOODS = ("deterministic", "maximum_likelihood", "variational_bayes")
DATA = Path("data")  # where `make data` puts datasets


def add_to(commands: Commands) -> None:
    """Add the two parsers."""
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
        help="kind of network (default: unet in the plane, reduced in space)",
    )
    parser.add_argument(
        "--likelihood",
        choices=LIKELIHOODS,
        default=LIKELIHOODS[0],
        help="deterministic (default), or with standard deviations",
    )
    parser.set_defaults(command=run_init)

    parser = add_command(
        commands,
        "schema",
        "print the keys of a configuration",
        "surrogate schema training",
        "surrogate schema --format json > config.schema.json",
    )
    add_arguments(parser)
    parser.set_defaults(command=run_schema)


def run_init(options: argparse.Namespace) -> None:
    """Write the file, and say what is next."""
    from shared_schema.common.errors import InputError
    from shared_schema.common.solution_file import require_suffix
    from surrogate.data.dataset import read_dataset
    from surrogate.training.first_config import first_config

    require_suffix(options.out, (".yaml",))
    require_writable(options.out)
    if options.out.exists():
        raise InputError(f"--out '{options.out}': exists, expected a new file")
    data = find_data(options.target)
    first = first_config(read_dataset(data, on_disk=True), options.model, options.likelihood)
    config = first.config()
    write_text(options.out, first.text())
    print(
        f"{options.out}: {config.architecture}; next: surrogate train {options.out} --data {data} "
        f"--out runs/{config.name} (with --dry-run it says what that takes)"
    )


def run_schema(options: argparse.Namespace) -> None:
    """Print the keys."""
    from surrogate.runs.config_schema import config_keys, config_schema

    print(printed(options, config_keys(), config_schema()))


def find_data(target: str) -> Path:
    """Return the structured dataset of a folder or of a case.

    Raises
    ------
    InputError
        If there is none.
    """
    from shared_schema.common.configuration import read_yaml
    from shared_schema.common.errors import InputError
    from shared_schema.manifest import MANIFEST

    folder = Path(target)
    if (folder / MANIFEST).is_file():
        return folder
    name = read_yaml(folder).get("name", "") if folder.is_file() else target
    places = [folder / "structured", DATA / str(name) / "structured"]
    for place in places:
        if (place / MANIFEST).is_file():
            return place
    raise InputError(
        f"CASE|DATA '{target}': no structured dataset there or at {places[-1]}; expected one made "
        "by `datagen structure`"
    )
