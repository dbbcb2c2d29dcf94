"""Benchmarks over networks with numbers of loads, as their options: ``beam2d_any:200``."""

from __future__ import annotations

import argparse
import logging
import warnings
from collections.abc import Callable, Sequence
from typing import Any

import torch

from experiments.framework.quiet import quiet
from shared_schema.common import Parser
from surrogate import OutsideTrainingWarning

__all__ = ["add_counted_networks", "over_networks"]


def add_counted_networks(parser: Parser, default: Sequence[str], what: str, seed: int) -> None:
    """Add networks with a number of something each, and the seed of what is drawn."""
    said = f"network and number of {what} (default {' '.join(default)})"
    parser.add_argument("networks", nargs="*", default=default, metavar="NAME:N", help=said)
    parser.add_argument("--seed", type=int, default=seed)


@quiet(logging.WARNING)
def over_networks(
    options: argparse.Namespace, compare: Callable[[str, int], dict[str, Any]]
) -> dict[str, Any]:
    """Results of a function of name and number for every network, with threads and seed."""
    warnings.simplefilter("ignore", OutsideTrainingWarning)
    pairs = [text.rpartition(":") for text in options.networks]
    found = [compare(name, int(count)) for name, _, count in pairs]
    return {"threads": torch.get_num_threads(), "seed": options.seed, "networks": found}
