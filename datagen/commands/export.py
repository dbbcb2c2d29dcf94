"""datagen export: write samples as a time series for ParaView, or the dataset in PLAID's format."""

from __future__ import annotations

import argparse
from pathlib import Path

from datagen.commands.make import add_nodal
from shared_schema.common.command_line import STRESSES, Commands, add_command
from shared_schema.common.errors import InputError
from shared_schema.common.files import require_writable
from shared_schema.common.solution_file import require_suffix


def add_export(commands: Commands) -> None:
    """Add ``datagen export``."""
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
    parser.set_defaults(command=_export)


def _export(options: argparse.Namespace) -> None:
    """Write the series or the dataset."""
    import datagen
    from datagen.output.paraview_series import SUFFIXES

    names = "backend", "python", "owner", "license"
    plaid = {name: getattr(options, name) for name in names if getattr(options, name) is not None}
    if options.format == "plaid":
        if options.samples is not None:
            raise InputError(f"--samples {options.samples}: expected none with --format plaid")
        require_writable(options.out)
        train, test = datagen.export_plaid(options.nodal, options.out, **plaid)
        print(f"{options.out}: {train} training and {test} test samples")
        return
    for name, value in plaid.items():
        raise InputError(f"--{name} {value}: expected with --format plaid")
    require_suffix(options.out, SUFFIXES)
    require_writable(options.out)
    series = {"samples": options.samples, "stresses": options.stresses}
    numbers = datagen.export(options.nodal, options.out, **series)
    print(f"{options.out}: {len(numbers)} samples, {numbers[0]} to {numbers[-1]}")
