"""What a study found, as kept in JSON: tables, numbers beside the paper's, claims, figures."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal, get_args

from pydantic import Field

from shared_schema.common.configuration import Frozen

Verdict = Literal["better", "reproduced", "differs"]
MARGIN = 1.5  # the factor within which a number counts as the paper's
LARGE = 999.5  # from here on numbers are written as whole ones
Cell = str | float | int | None


class DatasetRecord(Frozen):
    """A dataset that was used: its case, number of samples, and digest."""

    case: str
    samples: int
    digest: str


class RunRecord(Frozen):
    """A network that was trained: by which configuration, on what, how long.

    Attributes
    ----------
    config : str
    change : dict
        What differs from the shipped configuration.
    data : str
        Name of the dataset.
    seed : int
    fingerprint : str
        Digest of configuration and dataset.
    epochs : int
    minutes : float
        Number of epochs times the median time of one.
    parameters : int
        Trainable ones.
    network, training : str
        What it is and how it was trained, in words.
    hardware : str
    """

    config: str
    change: dict[str, Any]
    data: str
    seed: int
    fingerprint: str
    epochs: int
    minutes: float
    parameters: int
    network: str
    training: str
    hardware: str


class Comparison(Frozen):
    """A number beside the paper's.

    Attributes
    ----------
    what : str
    unit : str
    ours : float
    paper : float
    verdict : {"better", "reproduced", "differs"}
    """

    what: str
    unit: str
    ours: float
    paper: float
    verdict: Verdict


class Claim(Frozen):
    """A statement of the paper, and whether it holds here.

    Attributes
    ----------
    what : str
        The statement.
    holds : bool
    evidence : str
        The numbers by which it does or does not.
    better : bool
        Whether it is for the better if it does not hold, as of a failure that the paper admits.
    """

    what: str
    holds: bool
    evidence: str
    better: bool = False

    @property
    def verdict(self) -> Verdict:
        """Reproduced if it holds."""
        if self.holds:
            return "reproduced"
        return "better" if self.better else "differs"


class Table(Frozen):
    """A table: its caption, the heads of its columns, and rows of words and numbers."""

    caption: str
    head: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]


class Findings(Frozen):
    """What a study found.

    Attributes
    ----------
    tables : tuple of Table
    comparisons : tuple of Comparison
    claims : tuple of Claim
    captions : dict of str to str
        Caption of every figure, by its file.
    """

    tables: tuple[Table, ...] = ()
    comparisons: tuple[Comparison, ...] = ()
    claims: tuple[Claim, ...] = ()
    captions: dict[str, str] = Field(default_factory=dict)


class Record(Frozen):
    """A study that was done: what was run, and what was found.

    Attributes
    ----------
    study, scale : str
    fingerprint : str
        Digest of all that the findings depend on.
    datasets : dict of str to DatasetRecord
    runs : dict of str to RunRecord
    passes : int
    hardware : str
        Of the study itself.
    minutes : float
        Without training.
    software : dict of str to str
    findings : Findings
    """

    study: str
    scale: str
    fingerprint: str
    datasets: dict[str, DatasetRecord]
    runs: dict[str, RunRecord]
    passes: int
    hardware: str
    minutes: float
    software: dict[str, str]
    findings: Findings


def compare(what: str, unit: str, ours: float, paper: float, margin: float = MARGIN) -> Comparison:
    """Put an error, a time or another number that should be small beside the paper's.

    It is better below paper / margin, reproduced up to paper · margin, and differs above.
    """
    if ours < paper / margin:
        verdict: Verdict = "better"
    else:
        verdict = "reproduced" if ours <= paper * margin else "differs"
    return Comparison(what=what, unit=unit, ours=ours, paper=paper, verdict=verdict)


def tally(findings: Findings) -> dict[Verdict, int]:
    """How many numbers and statements got each verdict, the best first."""
    verdicts = [c.verdict for c in findings.comparisons] + [c.verdict for c in findings.claims]
    return {verdict: verdicts.count(verdict) for verdict in get_args(Verdict)}


def cell(value: Cell) -> str:
    """A cell: whole numbers as they are, others in three digits or more, nothing as a dash."""
    if value is None:
        return "–"
    if isinstance(value, float):
        return f"{value:.3g}" if abs(value) < LARGE else f"{value:.0f}"
    return str(value)


def listed(numbers: Mapping[str, float]) -> str:
    """Numbers with their names, for a sentence."""
    return ", ".join(f"{name} {number:.2f}" for name, number in numbers.items())
