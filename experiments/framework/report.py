"""Reports in Markdown, made from records: one on all studies of a scale, and their parts."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import Field

from experiments.framework.experiment import Experiment
from experiments.framework.record import Comparison, Record, Verdict, format_cell, tally
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
        contents(report, scale, records),
        *(
            section(report, scale, study, record, discussion.studies.get(study.name, ""))
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
    write_report(report, resources.scale, records, out)


def contents(report: Report, scale: Scale, records: Mapping[str, Record | None]) -> str:
    """Table of the studies; of the paper's, with the counts of their verdicts."""
    rows = []
    for study in report.studies:
        if study.name not in records:
            continue
        record = records[study.name]
        title = f"[{study.title}](#{anchor(study.title)})" if record else study.title
        if report.title_of is None:
            rows.append([title, "done" if record else NOT_DONE])
            continue
        counted = tally(record.findings).items() if record else ()
        counts = " · ".join(f"{n} {verdict}" for verdict, n in counted if n) or "–"
        counts = counts if scale.verdicts else NO_VERDICT
        rows.append([title, report.places(study), counts if record else NOT_DONE])
    head = ["study", ""] if report.title_of is None else ["study", "in the paper", "verdicts"]
    return markdown_table(head, rows)


def anchor(title: str) -> str:
    """Anchor of a heading in links."""
    kept = "".join(c for c in title.lower() if c.isalnum() or c in " -_")
    return kept.replace(" ", "-")


def section(
    report: Report, scale: Scale, study: Experiment[Any], record: Record, discussion: str
) -> str:
    """Section on a study: question, tables, numbers, claims, discussion and figures."""
    found = record.findings
    place = f" In the paper: {report.places(study)}." if study.labels else ""
    blocks = [f"## {study.title}", f"{study.question}{place}"]
    for table in found.tables:
        blocks += [
            table.caption,
            markdown_table(table.head, (map(format_cell, row) for row in table.rows)),
        ]
    if found.comparisons:
        head = ("", "here", "paper", "verdict")
        blocks.append(markdown_table(head, (comparison_row(c, scale) for c in found.comparisons)))
    blocks += [f"- {bold(c.verdict, scale)}: {c.what} {c.evidence}" for c in found.claims]
    if not (found.tables or found.comparisons or found.claims or found.captions):
        blocks.append("This scale has no dataset for it.")
    blocks.append(discussion)
    blocks += [f"![{caption}]({file})\n\n*{caption}*" for file, caption in found.captions.items()]
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
    machines = sorted({record.machine["hardware"] for record in records})
    return (
        f"## What was run\n\n{trained}\n{made}\nStudies on {'; '.join(machines)}. Every record "
        "(`*.json` beside this page) holds the whole digests, the changes to the configurations, "
        "the minutes of the study and the versions of the software. Minutes of a training: its "
        "epochs times the median time of one, so that pauses do not count."
    )


def markdown_table(head: Sequence[str], rows: Iterable[Iterable[str]]) -> str:
    """Markdown of a table."""
    lines = [head, ["---"] * len(head), *rows]
    return "".join(f"| {' | '.join(cells)} |\n" for cells in lines)
