"""The pages of the benchmarks are those made from the committed results."""

from __future__ import annotations

import importlib
import json
from typing import Any

import pytest

from experiments.benchmarks.publication import page_path, result_path

BENCHMARKS = {
    "equilibrium": "equilibrium",
    "equilibrium-debian-13": "equilibrium",
    "scaling": "scaling",
    "two-nodes": "two_nodes",
    "hdf5": "hdf5_throughput",
    "elements": "elements",
    "large-bodies": "large_bodies",
}


def results_of(name: str) -> dict[str, Any]:
    content: dict[str, Any] = json.loads(result_path(name).read_text())
    return content


@pytest.mark.parametrize("name", BENCHMARKS)
def test_page_is_made_from_the_results(name: str) -> None:
    module = importlib.import_module(f"experiments.benchmarks.{BENCHMARKS[name]}")
    results = results_of(name)
    assert page_path(name).read_text() == module.table(results)
    assert f"python -m {module.__name__}" in results["command"]


@pytest.mark.parametrize("name", ["equilibrium", "equilibrium-debian-13"])
def test_parts_of_a_load_case_add_up(name: str) -> None:
    """No part is negative, so none counts twice; the parts add up to the whole, in rounded ms."""
    for result in results_of(name)["parts"]:
        assert min(result["parts_ms"].values()) >= 0
        assert sum(result["parts_ms"].values()) == pytest.approx(result["whole_ms"], abs=1e-3)
