"""The pages of the benchmarks of `datagen` are those made from the committed records."""

from __future__ import annotations

import pytest

from experiments.benchmark_commands import PROGRAMS, find_benchmark
from experiments.benchmarks.benchmark import stored_record


@pytest.mark.parametrize("name", [name for name, of in PROGRAMS.items() if of == "datagen"])
def test_page_is_made_from_the_records(name: str) -> None:
    benchmark = find_benchmark(name)
    page = benchmark.path.read_text()
    assert page == benchmark.whole_page()
    assert f"`python -m experiments benchmark {name}" in page


@pytest.mark.parametrize("name", ["equilibrium", "equilibrium-debian-13"])
def test_parts_of_a_load_case_add_up(name: str) -> None:
    """No part is negative, so none counts twice; the parts add up to the whole, as rounded."""
    for result in stored_record(name).findings.numbers["parts"]:
        assert min(result["parts_ms"].values()) >= 0
        assert sum(result["parts_ms"].values()) == pytest.approx(
            result["whole_ms"], abs=1e-3, rel=1e-5
        )
