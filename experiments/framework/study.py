"""Studies, and running one: again only when its datasets, networks or scale have changed."""

from __future__ import annotations

import platform
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import torch
from matplotlib.figure import Figure

from experiments.framework.resources import Resources
from experiments.framework.study_record import (
    Claim,
    Comparison,
    Record,
    RecordedFindings,
    Table,
    read_record,
    write_record,
)
from shared_schema.common.drawing.figure_style import save
from shared_schema.common.errors import InputError
from shared_schema.manifest import digest_of
from surrogate.hardware import hardware


@dataclass
class StudyResult:
    """Result of a study in memory, figures included.

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
    """Reproduction of one table or figure of the paper, or a study beyond the paper.

    Attributes
    ----------
    name : str
    title : str
    labels : tuple of str
        Labels of its tables and figures in the paper's source; none beyond the paper.
    question : str
        One or two sentences for the report.
    datasets : tuple of str
        Names of the datasets that it needs besides those of its runs, or patterns.
    runs : tuple of str
        Names of the runs that it needs, or patterns such as ``beam3d-c*``.
    times : bool
        True if it measures times, which depend on the device.
    measure : callable
        Function that computes the result from the resources of a scale.
    """

    name: str
    title: str
    labels: tuple[str, ...]
    question: str
    measure: Callable[[Resources], StudyResult]
    datasets: tuple[str, ...] = ()
    runs: tuple[str, ...] = ()
    times: bool = False

    def fingerprint(self, resources: Resources) -> str:
        """Digest of all that the result depends on.

        The timing of the scale is left out: more repeats change the noise of a time only.
        """
        scale = resources.scale
        return digest_of(
            {
                "study": self.name,
                "device": resources.device.type if self.times else None,
                "passes": scale.passes,
                "datasets": {
                    name: resources.manifest(name).digest
                    for name in scale.matching_datasets(self.datasets)
                },
                "runs": {r: resources.run_fingerprint(r) for r in scale.matching(self.runs)},
            }
        )

    def used_datasets(self, resources: Resources) -> list[str]:
        """Names of its datasets, those of its runs included."""
        scale = resources.scale
        of_runs = [scale.runs[run].data for run in scale.matching(self.runs)]
        return list(dict.fromkeys([*scale.matching_datasets(self.datasets), *of_runs]))


def figure_file(study: str, figure: str) -> str:
    """File name of a figure."""
    return f"{study}-{figure}.png" if figure != study else f"{study}.png"


def current_record(study: Study, resources: Resources, out: Path) -> Record | None:
    """Read the record of a study if it matches the data and networks of the scale.

    Its figures must be there as well. Without the data at hand, the record counts as current.
    """
    record = read_record(out, study.name)
    if record is None or not all((out / file).is_file() for file in record.findings.captions):
        return None
    try:
        fingerprint = study.fingerprint(resources)
    except InputError:
        return record
    return record if record.fingerprint == fingerprint else None


def run_study(study: Study, resources: Resources, out: Path) -> Record:
    """Train the missing networks of a study, measure; write its figures, then its record."""
    scale = resources.scale
    for run in scale.matching(study.runs):
        resources.trained(run)
    began = time.perf_counter()
    result = study.measure(resources)
    captions = {}
    for name, (figure, caption) in result.figures.items():
        file = figure_file(study.name, name)
        save(figure, out / file)
        captions[file] = caption
    record = Record(
        study=study.name,
        scale=scale.name,
        fingerprint=study.fingerprint(resources),
        datasets={name: resources.dataset_record(name) for name in study.used_datasets(resources)},
        runs={run: resources.run_record(run) for run in scale.matching(study.runs)},
        passes=scale.passes,
        hardware=hardware(resources.device),
        minutes=(time.perf_counter() - began) / 60,
        software={"torch": torch.__version__, "python": platform.python_version()},
        findings=RecordedFindings(
            tables=tuple(result.tables),
            comparisons=tuple(result.comparisons),
            claims=tuple(result.claims),
            captions=captions,
        ),
    )
    write_record(record, out)
    return record
