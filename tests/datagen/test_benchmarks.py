"""The pages of the benchmarks of `datagen` are those made from the committed records."""

from __future__ import annotations

import pytest

from experiments.benchmark_commands import find_benchmark
from experiments.benchmarks.benchmark import page_path, stored_record

BENCHMARKS = {
    "corrections-beam2d_any": "corrections",
    "corrections-beam3d_any": "corrections",
    "equilibrium": "equilibrium",
    "equilibrium-debian-13": "equilibrium",
    "scaling": "scaling",
    "two-nodes": "two-nodes",
    "hdf5": "hdf5",
    "elements": "elements",
    "large-bodies": "large-bodies",
    "manufactured": "manufactured",
    "mechanical-mnist": "mechanical-mnist",
}


@pytest.mark.parametrize("name", BENCHMARKS)
def test_page_is_made_from_the_record(name: str) -> None:
    benchmark, record = find_benchmark(BENCHMARKS[name]), stored_record(name)
    assert page_path(name).read_text() == benchmark.page_of(record)
    assert f"python -m experiments benchmark {benchmark.name}" in record.command


@pytest.mark.parametrize("name", ["equilibrium", "equilibrium-debian-13"])
def test_parts_of_a_load_case_add_up(name: str) -> None:
    """No part is negative, so none counts twice; the parts add up to the whole, as rounded."""
    for result in stored_record(name).findings.numbers["parts"]:
        assert min(result["parts_ms"].values()) >= 0
        assert sum(result["parts_ms"].values()) == pytest.approx(
            result["whole_ms"], abs=1e-3, rel=1e-5
        )
