"""Numbers of README's table of results beside their records and the paper's; one opening."""

from __future__ import annotations

import json
from typing import Any

import pytest
import yaml

from experiments.benchmarks.seeds import ROW
from tests.end_to_end.commands import ROOT

README = (ROOT / "README.md").read_text()
ROWS = [row.groupdict() for row in ROW.finditer(README)]
PAPER = yaml.safe_load((ROOT / "experiments" / "paper" / "paper.yaml").read_text())["networks"]


def record_of(row: dict[str, str]) -> dict[str, Any]:
    """Return the JSON that a row links to."""
    content: dict[str, Any] = json.loads((ROOT / row["record"]).read_text())
    return content


def test_every_row_of_the_table_has_a_record() -> None:
    table = README.partition("|  | ē here |")[2].partition("\n\n")[0]
    assert len(ROWS) == len(table.splitlines()) - 2 > 10


@pytest.mark.parametrize("row", ROWS, ids=lambda row: f"{row['case']}-{row['error']}")
def test_error_is_that_of_the_record(row: dict[str, str]) -> None:
    """Errors of records are in m, those of the table in 10⁻³ m, rounded to its digits."""
    value: Any = record_of(row)
    for key in row["keys"].split("/"):
        value = value[key]
    digits = len(row["error"].partition(".")[2])
    assert f"{1e3 * value:.{digits}f}" == row["error"]


@pytest.mark.parametrize("row", ROWS, ids=lambda row: f"{row['case']}-{row['error']}")
def test_minutes_of_training_are_those_of_the_record(row: dict[str, str]) -> None:
    seconds = record_of(row).get("training_seconds")
    if seconds is not None:
        assert f"{seconds / 60:.0f}" == row["minutes"]


@pytest.mark.parametrize("row", ROWS, ids=lambda row: f"{row['case']}-{row['error']}")
def test_numbers_of_the_paper(row: dict[str, str]) -> None:
    likelihood = "variational_bayes" if "-vb-" in row["record"] else "deterministic"
    found = PAPER.get(row["case"], {}).get(likelihood)
    if found is None:
        assert (row["paper"], row["paper_minutes"]) == ("–", "–")
    else:
        assert float(row["paper"]) == found["mean_error_mm"]
        assert float(row["paper_minutes"]) == found["training_minutes"]


def test_the_site_begins_as_readme_does() -> None:
    opening = README.partition("\n## ")[0].replace("](docs/", "](")
    assert (ROOT / "docs" / "index.md").read_text().startswith(opening)
