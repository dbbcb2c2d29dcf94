"""The report on all studies of a scale: a page of Markdown made of their records."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from pydantic import Field

from shared_schema.common.atomic_file import write_text
from shared_schema.common.configuration import Frozen, read_yaml, validate
from surrogate.evaluation.paper import PAPER
from surrogate.studies.record import Comparison, Record, Verdict, cell, tally
from surrogate.studies.scale import Scale
from surrogate.studies.study import Study

PAGE = "README.md"
DISCUSSION = "discussion.yaml"
NOT_DONE = "not done"


class Discussion(Frozen):
    """What is said of the findings by hand: an introduction, and paragraphs on studies.

    Attributes
    ----------
    introduction : str
    studies : dict of str to str
    """

    introduction: str = ""
    studies: dict[str, str] = Field(default_factory=dict)


def write_report(
    scale: Scale, studies: Sequence[Study], records: Mapping[str, Record | None], out: Path
) -> None:
    """Write the page on all studies that were done at a scale.

    Parameters
    ----------
    scale : Scale
    studies : sequence of Study
        All there are, in order.
    records : mapping of str to Record or None
        By the name of the study; None if it was not done.
    out : Path
        Folder of their records and figures, and of ``discussion.yaml`` if there is one.

    Raises
    ------
    InputError
        If the discussion is damaged.
    """
    path = out / DISCUSSION
    said = validate(Discussion, read_yaml(path), str(path)) if path.is_file() else Discussion()
    parts = [
        f"# The paper's tables and figures, at scale `{scale.name}`",
        scale.description,
        said.introduction,
        verdicts(studies, records),
        *(
            section(study, record, said.studies.get(study.name, ""))
            for study in studies
            if (record := records[study.name]) is not None
        ),
        appendix([record for record in records.values() if record is not None]),
    ]
    write_text(out / PAGE, "\n\n".join(part.strip() for part in parts if part.strip()) + "\n")


def verdicts(studies: Sequence[Study], records: Mapping[str, Record | None]) -> str:
    """Every study with the number of its verdicts."""
    rows = []
    for study in studies:
        record = records[study.name]
        if record is None:
            rows.append((study.title, numbers(study), NOT_DONE))
        else:
            title = f"[{study.title}](#{anchor(study.title)})"
            counts = [f"{n} {verdict}" for verdict, n in tally(record.findings).items() if n]
            rows.append((title, numbers(study), " · ".join(counts) or "–"))
    return markdown_table(("study", "in the paper", "verdicts"), rows)


def numbers(study: Study) -> str:
    """Numbers of the paper's tables and figures."""
    return ", ".join(PAPER.title_of(label) for label in study.labels)


def anchor(title: str) -> str:
    """What a heading is called in links to it."""
    kept = "".join(c for c in title.lower() if c.isalnum() or c in " -_")
    return kept.replace(" ", "-")


def section(study: Study, record: Record, said: str) -> str:
    """One study: what it asks, tables, numbers and claims with verdicts, discussion, figures."""
    found = record.findings
    parts = [f"## {study.title}", f"{study.question} In the paper: {numbers(study)}."]
    for table in found.tables:
        parts += [table.caption, markdown_table(table.head, (map(cell, row) for row in table.rows))]
    if found.comparisons:
        head = ("", "here", "paper", "verdict")
        parts.append(markdown_table(head, map(comparison_row, found.comparisons)))
    parts += [f"- {mark(c.verdict)}: {c.what} {c.evidence}" for c in found.claims]
    parts.append(said)
    parts += [f"![{caption}]({file})\n\n*{caption}*" for file, caption in found.captions.items()]
    return "\n\n".join(part.strip() for part in parts if part.strip())


def comparison_row(comparison: Comparison) -> tuple[str, ...]:
    """One number beside the paper's, as cells."""
    unit = f" [{comparison.unit}]" if comparison.unit else ""
    ours, paper = cell(comparison.ours), cell(comparison.paper)
    return (f"{comparison.what}{unit}", ours, paper, mark(comparison.verdict))


def mark(verdict: Verdict) -> str:
    """A verdict as it stands in the text."""
    return f"**{verdict}**"


def appendix(records: Sequence[Record]) -> str:
    """What was run: networks, datasets, machines."""
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
    """Lay out a table in Markdown."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(f"| {' | '.join(cells)} |" for cells in lines)
