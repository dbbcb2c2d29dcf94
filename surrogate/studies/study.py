"""What a study is, and how it is done once: again only when what it depends on has changed."""

from __future__ import annotations

import json
import platform
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import torch
from matplotlib.figure import Figure

from shared_schema.common.atomic_file import write_text
from shared_schema.common.configuration import validate
from shared_schema.common.errors import InputError
from shared_schema.drawing.figure_style import save
from shared_schema.manifest import digest_of
from surrogate.hardware import hardware
from surrogate.studies.record import Claim, Comparison, Findings, Record, Table
from surrogate.studies.workshop import Workshop


@dataclass
class Outcome:
    """What a study finds, while it is at it.

    Attributes
    ----------
    tables : list of Table
    comparisons : list of Comparison
    claims : list of Claim
    figures : dict of str to (Figure, str)
        Figures and their captions, by name.
    """

    tables: list[Table] = field(default_factory=list)
    comparisons: list[Comparison] = field(default_factory=list)
    claims: list[Claim] = field(default_factory=list)
    figures: dict[str, tuple[Figure, str]] = field(default_factory=dict)


@dataclass(frozen=True)
class Study:
    """One table or figure of the paper.

    Attributes
    ----------
    name : str
    title : str
    labels : tuple of str
        Of the tables and figures in the paper's source.
    question : str
        What it is about, in a sentence or two.
    datasets : tuple of str
        Names of the datasets that it needs besides those of its runs.
    runs : tuple of str
        Names of the runs that it needs, or patterns such as ``beam3d-c*``.
    times : bool
        Whether it measures times, which are those of a device.
    conduct : callable
        Does it.
    """

    name: str
    title: str
    labels: tuple[str, ...]
    question: str
    conduct: Callable[[Workshop], Outcome]
    datasets: tuple[str, ...] = ()
    runs: tuple[str, ...] = ()
    times: bool = False

    def fingerprint(self, workshop: Workshop) -> str:
        """Digest of all that the findings depend on."""
        scale = workshop.scale
        return digest_of(
            {
                "study": self.name,
                "device": workshop.device.type if self.times else None,
                "passes": scale.passes,
                "datasets": {name: workshop.manifest(name).digest for name in self.datasets},
                "runs": {r: workshop.run_fingerprint(r) for r in scale.matching(self.runs)},
            }
        )


def record_path(out: Path, name: str) -> Path:
    """Where the record of a study lies; its figures are beside it."""
    return out / f"{name}.json"


def figure_name(study: str, figure: str) -> str:
    """File name of a figure."""
    return f"{study}-{figure}.png" if figure != study else f"{study}.png"


def read_record(out: Path, name: str) -> Record | None:
    """Read the record of a study, if it was done.

    Raises
    ------
    InputError
        If it is damaged.
    """
    path = record_path(out, name)
    if not path.is_file():
        return None
    try:
        content = json.loads(path.read_text())
    except ValueError as error:
        raise InputError(f"{path}: damaged ({error})") from None
    return validate(Record, content, str(path))


def current_record(study: Study, workshop: Workshop, out: Path) -> Record | None:
    """Record of a study if it was done on the data and networks of the scale, figures included.

    Where the data are not at hand, the record is taken for that of the scale.
    """
    record = read_record(out, study.name)
    if record is None or not all((out / file).is_file() for file in record.findings.captions):
        return None
    try:
        fingerprint = study.fingerprint(workshop)
    except InputError:
        return record
    return record if record.fingerprint == fingerprint else None


def do(study: Study, workshop: Workshop, out: Path) -> Record:
    """Do a study, training what is not trained yet; write its figures, then its record."""
    scale = workshop.scale
    for run in scale.matching(study.runs):
        workshop.trained(run)
    began = time.perf_counter()
    outcome = study.conduct(workshop)
    captions = {}
    for name, (figure, caption) in outcome.figures.items():
        file = figure_name(study.name, name)
        save(figure, out / file)
        captions[file] = caption
    record = Record(
        study=study.name,
        scale=scale.name,
        fingerprint=study.fingerprint(workshop),
        datasets={name: workshop.dataset_record(name) for name in used_datasets(study, workshop)},
        runs={run: workshop.run_record(run) for run in scale.matching(study.runs)},
        passes=scale.passes,
        hardware=hardware(workshop.device),
        minutes=(time.perf_counter() - began) / 60,
        software={"torch": torch.__version__, "python": platform.python_version()},
        findings=Findings(
            tables=tuple(outcome.tables),
            comparisons=tuple(outcome.comparisons),
            claims=tuple(outcome.claims),
            captions=captions,
        ),
    )
    write_text(record_path(out, study.name), spelled(record))
    return record


def used_datasets(study: Study, workshop: Workshop) -> list[str]:
    """Names of the datasets of a study, those of its runs included."""
    scale = workshop.scale
    of_runs = [scale.runs[run].data for run in scale.matching(study.runs)]
    return list(dict.fromkeys([*study.datasets, *of_runs]))


def spelled(record: Record) -> str:
    """A record as JSON, numbers in six digits."""
    return json.dumps(rounded(record.model_dump(mode="json")), indent=1, ensure_ascii=False) + "\n"


def rounded(content: object) -> object:
    """Plain data with numbers in six digits."""
    if isinstance(content, float):
        return float(f"{content:.6g}")
    if isinstance(content, list):
        return [rounded(value) for value in content]
    if isinstance(content, dict):
        return {key: rounded(value) for key, value in content.items()}
    return content
