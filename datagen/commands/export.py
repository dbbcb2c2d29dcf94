"""datagen export: write samples as a time series for ParaView, or the dataset in PLAID's format."""

from __future__ import annotations

import argparse
from pathlib import Path

from datagen.commands.options import add_nodal
from shared_schema.common.atomic_file import require_writable
from shared_schema.common.bodies.load_options import STRESSES
from shared_schema.common.command_line import Commands, add_command
from shared_schema.common.errors import InputError
from shared_schema.common.solution_file import require_suffix


def add_to(commands: Commands) -> None:
    """Add the command's parser."""
    parser = add_command(
        commands,
        "export",
        "write samples as a time series for ParaView, or the dataset in the PLAID format",
        "datagen export data/beam2d/nodal --out beam2d.xdmf --samples 0:20",
        "datagen export data/beam2d/nodal --format plaid --python plaid/bin/python "
        "--license CC-BY-4.0 --out beam2d-plaid",
    )
    add_nodal(parser)
    parser.add_argument(
        "--out",
        type=Path,
        required=True,
        metavar="FILE.(xdmf|pvd)|DIR",
        help="file for ParaView, or folder of the PLAID dataset",
    )
    parser.add_argument("--samples", metavar="A:B", help="A to B - 1 instead of the first 100")
    parser.add_argument("--stresses", action="store_true", help=STRESSES)
    parser.add_argument(
        "--format",
        choices=("paraview", "plaid"),
        default="paraview",
        help="paraview (default), or plaid: all samples, with training and test split",
    )
    plaid = parser.add_argument_group("PLAID")
    plaid.add_argument(
        "--backend",
        choices=("hf_datasets", "cgns", "zarr"),
        help="storage: hf_datasets (default; fields in float32), cgns or zarr (float64)",
    )
    plaid.add_argument(
        "--python", type=Path, metavar="PYTHON", help="interpreter of an environment with pyplaid"
    )
    plaid.add_argument("--owner", metavar="TEXT", help="owner of the dataset, for its infos.yaml")
    plaid.add_argument("--license", metavar="TEXT", help="its licence")
    parser.set_defaults(command=run)


def run(options: argparse.Namespace) -> None:
    """Write the series or the dataset."""
    given = {name: getattr(options, name) for name in ("backend", "python", "owner", "license")}
    given = {name: value for name, value in given.items() if value is not None}
    if options.format == "plaid":
        _export_plaid(options, **given)
        return
    for name, value in given.items():
        raise InputError(f"--{name} {value}: expected with --format plaid")
    from datagen.output.export import SUFFIXES, export

    require_suffix(options.out, SUFFIXES)
    require_writable(options.out)
    numbers = export(options.nodal, options.out, options.samples, options.stresses)
    print(f"{options.out}: {len(numbers)} samples, {numbers[0]} to {numbers[-1]}")


def _export_plaid(
    options: argparse.Namespace,
    backend: str = "hf_datasets",
    python: Path | None = None,
    owner: str = "unknown",
    license: str = "unknown",
) -> None:
    from datagen.plaid_format.exporting import export_plaid

    if options.samples is not None:
        raise InputError(f"--samples {options.samples}: expected none with --format plaid")
    require_writable(options.out)
    train, test = export_plaid(options.nodal, options.out, backend, python, owner, license)
    print(f"{options.out}: {train} training and {test} test samples")
