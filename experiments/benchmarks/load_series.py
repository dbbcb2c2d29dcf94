"""Error of the load series alone, without a network, by its order.

    python -m experiments benchmark load-series data/*/structured

writes its record and its page.
"""

from __future__ import annotations

import argparse
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch

from experiments.benchmarks.benchmark import Results
from experiments.framework.report import markdown_table
from experiments.framework.timing import timed
from shared_schema.common import Parser
from surrogate import Dataset, read_dataset
from surrogate.mechanics.series import SeriesResponse

LARGE = 1000  # nodes, above which fewer loads and orders are measured
LOADS, ORDERS = {False: 300, True: 60}, {False: range(2, 7), True: range(2, 6)}
BATCH = 20


def measure(options: argparse.Namespace) -> Results:
    """Measure all cases."""
    datasets = (read_dataset(path) for path in options.data)
    return {"cases": {dataset.manifest.name: errors_of(dataset) for dataset in datasets}}


@torch.inference_mode()
def errors_of(dataset: Dataset) -> Results:
    """Errors of the linear response, the sum of the terms, and their least energy; times."""
    assert dataset.material is not None
    large = len(dataset.geometry.coordinates) > LARGE
    test = dataset.test[: LOADS[large]]
    result: Results = {"samples": len(test), "orders": {}}
    for order in ORDERS[large]:
        response = SeriesResponse(dataset.geometry, dataset.material, False, order)
        nodal = torch.cat([response.at_nodes(part) for part in torch.split(test.force, BATCH)])
        truth = response.to_nodes(test.displacement.flatten(2))
        if not result["orders"]:
            result["orders"]["1"] = {"least": summary(nodal - truth)}
        seconds, least, sums = [], [], []
        for one in torch.split(nodal, 1):
            further, taken = timed(partial(response.beyond_first, one))
            least.append(one + further[0])
            seconds.append(taken)
            sums.append(
                torch.stack(response.series.terms(one.double().mT)[0]).sum(dim=0).mT.float()
            )
        result["orders"][str(order)] = {
            "least": summary(torch.cat(least) - truth),
            "sum": summary(torch.cat(sums) - truth),
            "median_ms": 1e3 * float(np.median(seconds)),
        }
    return result


def summary(difference: torch.Tensor) -> dict[str, float]:
    """Mean, median and largest of the samples' mean errors in m: (N, d, n_nodes)."""
    errors = difference.abs().mean(dim=(1, 2)).double().numpy()
    return {
        "mean": float(errors.mean()),
        "median": float(np.median(errors)),
        "largest": float(errors.max()),
    }


def _cell(one: dict[str, Any], key: str) -> str:
    """Mean and median in 10⁻³ m."""
    found = one.get(key)
    if found is None:
        return "–"
    return f"{1e3 * found['mean']:.3g} ({1e3 * found['median']:.2g})"


def page(results: Results) -> str:
    """Make the page."""
    rows = [
        [f"`{name}`", str(case["samples"]), order, _cell(one, "sum"), _cell(one, "least")]
        for name, case in results["cases"].items()
        for order, one in case["orders"].items()
        if order != "1"
    ]
    return (
        "Mean errors of the [load series](../background/networks.md#load-series) in 10⁻³ m under "
        "loads of the test split, in parentheses the median, by the order of the last term: of the "
        "sum of the terms, and of their combination with the least potential energy.\n\n"
        f"{markdown_table(['case', 'loads', 'order', 'sum', 'least energy'], rows)}"
    )


def arguments(parser: Parser) -> None:
    """Add the options."""
    parser.add_argument("data", nargs="+", type=Path, help="structured datasets")


TITLE = "The load series without a network"
