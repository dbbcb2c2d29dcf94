"""Reports in Markdown, made from records: one on all studies of a scale, and their parts."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import Field

from experiments.framework.experiment import Experiment
from experiments.framework.record import (
    Comparison,
    Record,
    RunRecord,
    Verdict,
    format_cell,
    tally,
)
from experiments.framework.runner import current_record
from shared_schema.common import Frozen, read_yaml, validate, write_text

if TYPE_CHECKING:
    from experiments.framework.resources import Resources
    from experiments.framework.scale import Scale

PAGE = "README.md"
DISCUSSION = "discussion.yaml"
NOT_DONE = "not done"
NO_VERDICT = "not at this scale"  # instead of verdicts, where numbers mean nothing


@dataclass(frozen=True)
class Report:
    """A report and its studies.

    Attributes
    ----------
    name : str
        Name of its folder in ``docs``.
    title : str
    studies : tuple of Experiment
        All studies in the order of the report.
    scales : Path
        Folder of its shipped scales.
    title_of : callable, optional
        Number of a table or figure of the paper by its label. Only a report on the paper has
        verdicts.
    """

    name: str
    title: str
    studies: tuple[Experiment[Any], ...]
    scales: Path
    title_of: Callable[[str], str] | None = None

    def places(self, study: Experiment[Any]) -> str:
        """Numbers of the tables and figures of a study in the paper."""
        return ", ".join(map(self.title_of, study.labels)) if self.title_of else ""

    def studies_at(self, scale: Scale) -> list[Experiment[Any]]:
        """Studies of which a scale has networks, or that need none."""
        return [study for study in self.studies if not study.runs or scale.matching(study.runs)]


class Discussion(Frozen):
    """Discussion of the findings, written by hand.

    Attributes
    ----------
    introduction : str
        First paragraphs of the report.
    studies : dict of str to str
        Paragraphs by the name of the study.
    tables : dict of str to list of int
        Which tables of a study stand on the page, counted from 0; by default all.
    """

    introduction: str = ""
    studies: dict[str, str] = Field(default_factory=dict)
    tables: dict[str, list[int]] = Field(default_factory=dict)


def write_report(
    report: Report, scale: Scale, records: Mapping[str, Record | None], out: Path
) -> None:
    """Write the page on all studies that have a record at a scale.

    Parameters
    ----------
    report : Report
    scale : Scale
    records : mapping of str to Record or None
        Records by the name of the study; None if the study was not run, or found nothing.
    out : Path
        Folder of the records, the figures and the optional ``discussion.yaml``.

    Raises
    ------
    InputError
        If the discussion is damaged.
    """
    path = out / DISCUSSION
    discussion = (
        validate(Discussion, read_yaml(path), str(path)) if path.is_file() else Discussion()
    )
    blocks = [
        f"# {report.title}, at scale `{scale.name}`",
        scale.description,
        discussion.introduction,
        contents(report, scale, records),
        *(
            section(scale, study, record, discussion)
            for study in report.studies
            if (record := records.get(study.name)) is not None
        ),
        appendix([record for record in records.values() if record is not None]),
    ]
    write_text(out / PAGE, "\n\n".join(block.strip() for block in blocks if block.strip()) + "\n")


def write_current(report: Report, resources: Resources, out: Path) -> None:
    """Write the page on all studies of a report with a current record."""
    studies = report.studies_at(resources.scale)
    records = {study.name: current_record(study, resources, out) for study in studies}
    for name, record in records.items():
        if record and not (record.findings.tables or record.findings.captions):
            records[name] = None  # the scale has no dataset for it
    write_report(report, resources.scale, records, out)


def contents(report: Report, scale: Scale, records: Mapping[str, Record | None]) -> str:
    """Table of the paper's studies with counts of verdicts; of others, those not done."""
    studies = [study for study in report.studies if study.name in records]
    if report.title_of is None:
        missing = [study.title for study in studies if records[study.name] is None]
        return f"{NOT_DONE.capitalize()}: {', '.join(missing)}." if missing else ""
    rows = []
    for study in studies:
        record = records[study.name]
        title = f"[{study.title}](#{anchor(study.title)})" if record else study.title
        counted = tally(record.findings).items() if record else ()
        counts = " · ".join(f"{n} {verdict}" for verdict, n in counted if n) or "–"
        counts = counts if scale.verdicts else NO_VERDICT
        rows.append([title, report.places(study), counts if record else NOT_DONE])
    return markdown_table(["study", "in the paper", "verdicts"], rows)


def anchor(title: str) -> str:
    """Anchor of a heading in links."""
    kept = "".join(c for c in title.lower() if c.isalnum() or c in " -_")
    return kept.replace(" ", "-")


def section(scale: Scale, study: Experiment[Any], record: Record, discussion: Discussion) -> str:
    """Section on a study: question, tables, numbers, claims, discussion and figures."""
    found = record.findings
    blocks = [f"## {study.title}", study.question]
    shown = discussion.tables.get(study.name, range(len(found.tables)))
    for table in (found.tables[number] for number in shown):
        blocks += [
            table.caption,
            markdown_table(table.head, (map(format_cell, row) for row in table.rows)),
        ]
    if found.comparisons:
        head = ("", "here", "paper", "verdict")
        blocks.append(markdown_table(head, (comparison_row(c, scale) for c in found.comparisons)))
    blocks.append(
        "\n".join(f"- {bold(c.verdict, scale)}: {c.what} {c.evidence}" for c in found.claims)
    )
    blocks.append(discussion.studies.get(study.name, ""))
    blocks += [f"![{study.title}]({file})\n\n*{text}*" for file, text in found.captions.items()]
    return "\n\n".join(block.strip() for block in blocks if block.strip())


def comparison_row(comparison: Comparison, scale: Scale) -> tuple[str, ...]:
    """Row of a number beside the paper's."""
    unit = f" [{comparison.unit}]" if comparison.unit else ""
    ours, paper = format_cell(comparison.ours), format_cell(comparison.paper)
    return (f"{comparison.what}{unit}", ours, paper, bold(comparison.verdict, scale))


def bold(verdict: Verdict, scale: Scale) -> str:
    """Markdown of a verdict, if there are verdicts at a scale."""
    return f"**{verdict if scale.verdicts else NO_VERDICT}**"


def appendix(records: Sequence[Record]) -> str:
    """Appendix on the networks, datasets and machines that were used."""
    runs = {name: run for record in records for name, run in record.runs.items()}
    alike: dict[tuple[str, str, str], dict[str, RunRecord]] = {}
    for name, run in runs.items():
        loss = run.training.split(",")[0]
        alike.setdefault((run.network, loss, f"{run.parameters / 1e6:.3g} M"), {})[name] = run
    trained = markdown_table(
        ("network", "loss", "parameters", "min", "runs"),
        ((*kind, minutes(of.values()), code(series(of))) for kind, of in alike.items()),
    )
    trainers = "; ".join(sorted({run.hardware for run in runs.values()}))
    machines = "; ".join(sorted({record.machine["hardware"] for record in records}))
    seeds = ", ".join(map(str, sorted({run.seed for run in runs.values()})))
    return (
        f"## What was run\n\n{trained}\nTrainings, of seed {seeds}, ran on {trainers}; studies on "
        f"{machines}. Minutes of a training are its epochs times the median time of one. Every "
        "record (`*.json` beside this page) has all tables, configurations, datasets, epochs, "
        "digests and versions."
    )


def minutes(runs: Iterable[RunRecord]) -> str:
    """Minutes of a training, or the least and the most of several."""
    ordered = sorted(run.minutes for run in runs)
    least, most = f"{ordered[0]:.3g}", f"{ordered[-1]:.3g}"
    return least if least == most else f"{least} to {most}"


def series(names: Iterable[str]) -> dict[str, None]:
    """Names of runs, those of one series over the number of samples as one."""
    return dict.fromkeys(re.sub(r"-n\d+$", "-n*", name) for name in names)


def code(names: Iterable[str]) -> str:
    """Names as code, separated by commas."""
    return ", ".join(f"`{name}`" for name in names)


def table_of(
    rows: Iterable[Mapping[str, Any]], columns: Mapping[str, str | Callable[[Any], str]]
) -> str:
    """Markdown of a table: a line for each mapping, a cell by its format or by a function."""
    cells = (
        [cell.format_map(row) if isinstance(cell, str) else cell(row) for cell in columns.values()]
        for row in rows
    )
    return markdown_table(list(columns), cells)


def markdown_table(head: Sequence[str], rows: Iterable[Iterable[str]]) -> str:
    """Markdown of a table."""
    lines = [head, ["---"] * len(head), *rows]
    return "".join(f"| {' | '.join(cells)} |\n" for cells in lines)
