"""Arguments that several commands have."""

from __future__ import annotations

from pathlib import Path

from shared_schema.common.command_line import Parser, add_set

CASE = "YAML file, or the name of a shipped case"
VOLUMETRIC = ("paper", "quadratic")
TRUST = "allow the case's gmsh script to run programs and to read and write files"


def add_case(parser: Parser) -> None:
    """Add CASE, --volumetric, --trust and --set."""
    parser.add_argument("case", metavar="CASE", help=CASE)
    parser.add_argument(
        "--volumetric", choices=VOLUMETRIC, help="volumetric term instead of the case's"
    )
    parser.add_argument("--trust", action="store_true", help=TRUST)
    add_set(parser, "the case", "material.poisson_ratio=0.3")


def add_nodal(parser: Parser) -> None:
    """Add NODAL_DIR."""
    parser.add_argument(
        "nodal", type=Path, metavar="NODAL_DIR", help="nodal dataset, as `datagen run` makes it"
    )
