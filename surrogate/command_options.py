"""Arguments that several commands have."""

from __future__ import annotations

import argparse
import os
from pathlib import Path

from shared_schema.common.command_line import Parser

RUN = "run folder, or a trained network of the package (surrogate list)"


def add_run(parser: Parser) -> None:
    """Add RUN."""
    parser.add_argument("run", type=Path, metavar="RUN", help=RUN)


def add_out(parser: Parser, file: str, what: str) -> None:
    """Add --out, which is required."""
    parser.add_argument("--out", type=Path, required=True, metavar=file, help=what)


def add_device(parser: Parser) -> None:
    """Add --device."""
    parser.add_argument(
        "--device",
        choices=("auto", "cpu", "cuda"),
        default="auto",
        help="processor; auto (default) takes a GPU if there is one",
    )


def add_data(parser: Parser, what: str, several: bool = False) -> None:
    """Add --data, a structured dataset, or several by repeating it."""
    action = "append" if several else "store"
    parser.add_argument("--data", type=Path, required=True, action=action, metavar="DIR", help=what)


def add_passes(parser: Parser, what: str) -> None:
    """Add --passes, with what it means to the command, and --seed."""
    parser.add_argument("--passes", type=int, metavar="T", help=what)
    parser.add_argument("--seed", type=int, metavar="S", help="seed of the passes (default 0)")


def add_family(parser: Parser) -> None:
    """Add --family, of random load cases."""
    parser.add_argument(
        "--family",
        default="trained",
        metavar="FAMILY",
        help="random loads: 'trained', those of the training (default), or such as "
        "'loads=1-8,reach=2,places=free' (trained, surface or free)",
    )


def given_passes(options: argparse.Namespace) -> dict[str, int]:
    """Return the given options among --passes and --seed."""
    given = {"passes": options.passes, "seed": options.seed}
    return {name: value for name, value in given.items() if value is not None}


def positive(text: str) -> float:
    """Read a positive number.

    Raises
    ------
    argparse.ArgumentTypeError
        If the text is no positive finite number.
    """
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if not 0 < value < float("inf"):
        raise argparse.ArgumentTypeError(f"'{text}': expected a positive number")
    return value


def whole(text: str) -> int:
    """Read a number of things, from 1 to 10 millions.

    Raises
    ------
    argparse.ArgumentTypeError
        If the text is none.
    """
    if not (text.isdigit() and 0 < int(text) <= 10**7):
        raise argparse.ArgumentTypeError(f"'{text}': expected a number from 1 to 10000000")
    return int(text)


def seeds(text: str) -> range:
    """Read A:B, the seeds from A to B - 1.

    Raises
    ------
    argparse.ArgumentTypeError
        If the text is none, or no seed is between.
    """
    first, _, end = text.partition(":")
    if not (first.isdecimal() and end.isdecimal() and int(first) < int(end) <= 2**63):
        raise argparse.ArgumentTypeError(f"'{text}': expected seeds A:B, A < B, such as 0:5")
    return range(int(first), int(end))


def share(text: str) -> float:
    """Read a number between 0 and 1.

    Raises
    ------
    argparse.ArgumentTypeError
        If the text is none.
    """
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if not 0 < value < 1:
        raise argparse.ArgumentTypeError(f"'{text}': expected a number between 0 and 1")
    return value


def relative(text: str) -> float:
    """Read a relative size from 0 to less than 1, also in percent, such as 5%.

    Raises
    ------
    argparse.ArgumentTypeError
        If the text is none.
    """
    try:
        value = float(text.removesuffix("%")) / (100 if text.endswith("%") else 1)
    except ValueError:
        value = -1.0
    if not 0 <= value < 1:
        raise argparse.ArgumentTypeError(f"'{text}': expected a part of 1, such as 5% or 0.05")
    return value


def speaks() -> bool:
    """True in the only process, or in the first one that ``torchrun`` has started."""
    return os.environ.get("RANK", "0") == "0"
