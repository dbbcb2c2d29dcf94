"""Options that name loads, the same in both programs."""

from __future__ import annotations

import argparse
from pathlib import Path

STRESSES = "add stresses, strain energy and reactions"


def add_held(parser: argparse.ArgumentParser) -> None:
    """Add ``--hold``."""
    parser.add_argument(
        "--hold",
        dest="held",
        action="append",
        default=[],
        metavar="X,Y[,Z]|GROUP:UX,UY[,UZ]",
        help="displacement in m of the node at X,Y[,Z] or of a group, - for a free component; "
        "repeatable",
    )


def add_tool(parser: argparse.ArgumentParser) -> None:
    """Add ``--tool``."""
    forms = "sphere:X,Y[,Z]:R|capsule:X,Y[,Z]:X,Y[,Z]:R|plane:X,Y[,Z]:NX,NY[,NZ]|mesh:FILE"
    parser.add_argument(
        "--tool",
        metavar=forms,
        help="rigid tool that the surface of the body keeps out of, in m; a plane "
        "has the normal that points out of it",
    )


def add_loads(parser: argparse.ArgumentParser) -> None:
    """Add ``--load``, ``--forces``, ``--body-force`` and ``--nearest``."""
    parser.add_argument(
        "--load",
        action="append",
        default=[],
        metavar="X,Y[,Z][,R]|GROUP:FX,FY[,FZ]",
        help="force in N at the node at X,Y[,Z] in m, or spread smoothly over the surface within R "
        "m of this place, or on a group of the mesh, uniform over its cells or facets; GROUP:P is "
        "a pressure in Pa; repeatable",
    )
    parser.add_argument(
        "--forces",
        action="append",
        default=[],
        type=Path,
        metavar="FILE.(npz|csv)",
        help="forces of a solution file, or lines X,Y[,Z],FX,FY[,FZ]; repeatable",
    )
    parser.add_argument(
        "--body-force",
        metavar="BX,BY[,BZ]",
        help="force in N per m³ of the undeformed body, such as its weight 0,0,-9810",
    )
    parser.add_argument(
        "--nearest", action="store_true", help="let forces act at the nearest node, and say which"
    )
