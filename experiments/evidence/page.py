"""The page of evidence: requirement, tests, what they hold, and what was last measured.

python -m experiments evidence
"""

from __future__ import annotations

from pathlib import Path

from experiments.evidence.requirements import SEPARATOR, Area, read_requirements
from experiments.framework.machine import ROOT
from experiments.framework.report import markdown_table
from shared_schema.common import write_text

PAGE = ROOT / "docs" / "evidence.md"
BEGINNING = """# Evidence

What the two programs are required to do, the tests that hold it, and what was measured last, with
the commit and the record. `python -m experiments evidence` makes this page from
[`requirements.yaml`](../experiments/evidence/requirements.yaml) and the records; a test fails
if one is missing.

[A credibility file](credibility.md) uses this evidence for one context of use.
"""


def page(areas: tuple[Area, ...]) -> str:
    """Make the page."""
    parts = [BEGINNING]
    for area in areas:
        rows = (
            (r.requirement, r.held, ", ".join(map(link, r.tests)), r.figure())
            for r in area.requirements
        )
        head = ("requirement", "held", "tests", "last measured")
        parts.append(f"## {area.area}\n\n{markdown_table(head, rows)}")
    return "\n".join(parts)


def link(test: str) -> str:
    """Link to the file of a test, with its name."""
    path, _, function = test.partition(SEPARATOR)
    return f"[`{function}`](../tests/{path})"


def write_page(path: Path = PAGE) -> None:
    """Write the page."""
    write_text(path, page(read_requirements()))
