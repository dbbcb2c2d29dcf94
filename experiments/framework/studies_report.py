"""Report on all studies of a scale: a Markdown page made from their records."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from pydantic import Field

from experiments.framework.scale import Scale
from experiments.framework.study import Study
from experiments.framework.study_record import Comparison, Record, Verdict, format_cell, tally
from experiments.paper.published_numbers import PAPER
from shared_schema.common.atomic_file import write_text
from shared_schema.common.configuration import Frozen, read_yaml, validate

PAGE = "README.md"
DISCUSSION = "discussion.yaml"
NOT_DONE = "not done"


@dataclass(frozen=True)
class Report:
    """A report and its studies.

    Attributes
    ----------
    name : str
        Name of its folder in ``docs``.
    title : str
    studies : tuple of Study
        All studies in the order of the report.
    scales : Path
        Folder of its shipped scales.
    """

    name: str
    title: str
    studies: tuple[Study, ...]
    scales: Path


class Discussion(Frozen):
    """Discussion of the findings, written by hand.

    Attributes
    ----------
    introduction : str
        First paragraphs of the report.
    studies : dict of str to str
        Paragraphs by the name of the study.
    """

    introduction: str = ""
    studies: dict[str, str] = Field(default_factory=dict)


def write_report(
    report: Report, scale: Scale, records: Mapping[str, Record | None], out: Path
) -> None:
    """Write the page on all studies that have a record at a scale.

    Parameters
    ----------
    report : Report
    scale : Scale
    records : mapping of str to Record or None
        Records by the name of the study; None if the study was not run.
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
        verdicts(report.studies, records),
        *(
            section(study, record, discussion.studies.get(study.name, ""))
            for study in report.studies
            if (record := records[study.name]) is not None
        ),
        appendix([record for record in records.values() if record is not None]),
    ]
    write_text(out / PAGE, "\n\n".join(block.strip() for block in blocks if block.strip()) + "\n")


def verdicts(studies: Sequence[Study], records: Mapping[str, Record | None]) -> str:
    """Table of all studies with the counts of their verdicts."""
    rows = []
    for study in studies:
        record = records[study.name]
        if record is None:
            rows.append([study.title, paper_numbers(study), NOT_DONE])
        else:
            title = f"[{study.title}](#{anchor(study.title)})"
            counts = [f"{n} {verdict}" for verdict, n in tally(record.findings).items() if n]
            rows.append([title, paper_numbers(study), " · ".join(counts) or "–"])
    head = ["study", "in the paper", "verdicts"]
    if not any(study.labels for study in studies):
        for line in (head, *rows):
            del line[1]
    return markdown_table(head, rows)


def paper_numbers(study: Study) -> str:
    """Numbers of the tables and figures of a study in the paper."""
    return ", ".join(PAPER.title_of(label) for label in study.labels)


def anchor(title: str) -> str:
    """Anchor of a heading in links."""
    kept = "".join(c for c in title.lower() if c.isalnum() or c in " -_")
    return kept.replace(" ", "-")


def section(study: Study, record: Record, discussion: str) -> str:
    """Section on a study: question, tables, numbers, claims, discussion and figures."""
    found = record.findings
    place = f" In the paper: {paper_numbers(study)}." if study.labels else ""
    blocks = [f"## {study.title}", f"{study.question}{place}"]
    for table in found.tables:
        blocks += [
            table.caption,
            markdown_table(table.head, (map(format_cell, row) for row in table.rows)),
        ]
    if found.comparisons:
        head = ("", "here", "paper", "verdict")
        blocks.append(markdown_table(head, map(comparison_row, found.comparisons)))
    blocks += [f"- {bold(c.verdict)}: {c.what} {c.evidence}" for c in found.claims]
    if not (found.tables or found.comparisons or found.claims or found.captions):
        blocks.append("This scale has no dataset for it.")
    blocks.append(discussion)
    blocks += [f"![{caption}]({file})\n\n*{caption}*" for file, caption in found.captions.items()]
    return "\n\n".join(block.strip() for block in blocks if block.strip())


def comparison_row(comparison: Comparison) -> tuple[str, ...]:
    """Row of a number beside the paper's."""
    unit = f" [{comparison.unit}]" if comparison.unit else ""
    ours, paper = format_cell(comparison.ours), format_cell(comparison.paper)
    return (f"{comparison.what}{unit}", ours, paper, bold(comparison.verdict))


def bold(verdict: Verdict) -> str:
    """Markdown of a verdict."""
    return f"**{verdict}**"


def appendix(records: Sequence[Record]) -> str:
    """Appendix on the networks, datasets and machines that were used."""
    runs = {name: run for record in records for name, run in record.runs.items()}
    datasets = {name: data for record in records for name, data in record.datasets.items()}
    trained = markdown_table(
        (
            "run",
            "configuration",
            "data",
            "network",
            "training",
            "seed",
            "parameters",
            "min",
            "on",
            "digest",
        ),
        (
            (
                f"`{name}`",
                f"`{run.config}`{', changed' if run.change else ''}",
                f"`{run.data}`",
                run.network,
                run.training,
                str(run.seed),
                f"{run.parameters / 1e6:.3g} M",
                f"{run.minutes:.3g}",
                run.hardware,
                f"`{run.fingerprint[:8]}`",
            )
            for name, run in runs.items()
        ),
    )
    made = markdown_table(
        ("dataset", "case", "samples", "digest"),
        (
            (f"`{name}`", f"`{data.case}`", str(data.samples), f"`{data.digest[:8]}`")
            for name, data in datasets.items()
        ),
    )
    machines = sorted({record.hardware for record in records})
    return (
        f"## What was run\n\n{trained}\n\n{made}\n\nStudies on {'; '.join(machines)}. Every record "
        "(`*.json` beside this page) holds the whole digests, the changes to the configurations, "
        "the minutes of the study and the versions of the software. Minutes of a training: its "
        "epochs times the median time of one, so that pauses do not count."
    )


def markdown_table(head: Sequence[str], rows: Iterable[Iterable[str]]) -> str:
    """Markdown of a table."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(f"| {' | '.join(cells)} |" for cells in lines)
