"""Records of experiments in JSON: inputs, machine, command, findings, and a digest of all that."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, Literal, TypeVar, get_args

import numpy as np
from pydantic import Field, field_validator

from shared_schema import digest_of
from shared_schema.common import Frozen, InputError, validate, write_text

Verdict = Literal["better", "reproduced", "differs"]
MARGIN = 1.5  # the factor within which a number counts as the paper's
LARGE = 999.5  # smallest number that is written without decimals
Cell = str | float | int | None
Thing = TypeVar("Thing")


class DatasetRecord(Frozen):
    """Case, number of samples and digest of a dataset that was used."""

    case: str
    samples: int
    digest: str


class RunRecord(Frozen):
    """Configuration, data, size and training time of a network that was used.

    Attributes
    ----------
    config : str
        Name of the shipped configuration.
    change : dict
        Keys that differ from the shipped configuration.
    data : str
        Name of the dataset.
    seed : int
    fingerprint : str
        Digest of configuration and dataset.
    epochs : int
    minutes : float
        Number of epochs times the median time of one.
    parameters : int
        Number of trainable parameters.
    network, training : str
        Description of the architecture and of the training.
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
        Name of the number.
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
    """A statement of the paper, tested on the results here.

    Attributes
    ----------
    what : str
        The statement.
    holds : bool
        Result of the test.
    evidence : str
        Sentence with the numbers that decide it.
    better : bool
        True if it is an improvement when the statement does not hold, as with a failure that the
        paper admits.
    """

    what: str
    holds: bool
    evidence: str
    better: bool = False

    @field_validator("holds", mode="before")
    @classmethod
    def _of_numpy_too(cls, holds: object) -> object:
        return bool(holds) if isinstance(holds, np.bool_) else holds

    @property
    def verdict(self) -> Verdict:
        """Reproduced if the statement holds."""
        if self.holds:
            return "reproduced"
        return "better" if self.better else "differs"


class Table(Frozen):
    """A table: its caption, the heads of its columns, and rows of words and numbers."""

    caption: str
    head: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]

    @classmethod
    def of(
        cls, caption: str, things: Iterable[Thing], columns: Mapping[str, Callable[[Thing], Cell]]
    ) -> Table:
        """Make a table of a row for each thing, its cells by the functions of the columns."""
        rows = tuple(tuple(cell(thing) for cell in columns.values()) for thing in things)
        return cls(caption=caption, head=tuple(columns), rows=rows)


class RecordedFindings(Frozen):
    """Findings as recorded, without the figures themselves.

    Attributes
    ----------
    tables : tuple of Table
    comparisons : tuple of Comparison
    claims : tuple of Claim
    captions : dict of str to str
        Caption of every figure, by its file.
    numbers : dict
        Measured numbers as plain data.
    """

    tables: tuple[Table, ...] = ()
    comparisons: tuple[Comparison, ...] = ()
    claims: tuple[Claim, ...] = ()
    captions: dict[str, str] = Field(default_factory=dict)
    numbers: dict[str, Any] = Field(default_factory=dict)


class Record(Frozen):
    """An experiment that was measured: its inputs, its findings and the machine.

    Attributes
    ----------
    experiment : str
        Name of the experiment.
    configuration : dict
        Scale and number of stochastic passes, or options of the command.
    seed : int
        Seed of everything that is drawn.
    command : str
        Command that measures it again.
    machine : dict
        Processor and load; of what uses PyTorch, the device.
    software : dict of str to str
        Versions by package, and the commit of the source.
    datasets : dict of str to DatasetRecord
    runs : dict of str to RunRecord
    inputs : str
        Digest of all that the findings depend on.
    seconds : float
        Duration without training, over all starts.
    finished : bool
        False if the next start goes on with it.
    error : str
        Traceback of a failure.
    findings : RecordedFindings
    digest : str
        Digest of all other entries.
    """

    experiment: str
    configuration: dict[str, Any]
    seed: int
    command: str
    machine: dict[str, Any]
    software: dict[str, str]
    datasets: dict[str, DatasetRecord] = Field(default_factory=dict)
    runs: dict[str, RunRecord] = Field(default_factory=dict)
    inputs: str
    seconds: float
    finished: bool = True
    error: str = ""
    findings: RecordedFindings
    digest: str = ""

    def plain(self) -> dict[str, Any]:
        """Return all entries as plain data, floats rounded to six digits, with their digest."""
        content: dict[str, Any] = rounded(self.model_dump(mode="json", exclude={"digest"}))
        return {**content, "digest": digest_of(content)}


def record_path(out: Path, name: str) -> Path:
    """File of the record of an experiment; its figures are beside it."""
    return out / f"{name}.json"


def read_record(path: Path) -> Record | None:
    """Read a record, or return None if there is no such file.

    Raises
    ------
    InputError
        If the record is damaged.
    """
    if not path.is_file():
        return None
    try:
        content = json.loads(path.read_text())
    except ValueError as error:
        raise InputError(f"{path}: damaged ({error})") from None
    if not isinstance(content, dict):
        raise InputError(f"{path}: damaged (not a record)")
    record = validate(Record, content, str(path))
    if record.digest != digest_of({key: content[key] for key in content if key != "digest"}):
        raise InputError(f"{path}: damaged (its digest is not that of its content)")
    return record


def write_record(record: Record, path: Path) -> None:
    """Write a record, sealed by its digest."""
    write_text(path, json.dumps(record.plain(), indent=1, ensure_ascii=False) + "\n")


def rounded(content: Any) -> Any:
    """Round the floats in plain data to six digits."""
    if isinstance(content, float):
        return float(f"{content:.6g}")
    if isinstance(content, list):
        return [rounded(value) for value in content]
    if isinstance(content, dict):
        return {key: rounded(value) for key, value in content.items()}
    return content


def compare(what: str, unit: str, ours: float, paper: float, margin: float = MARGIN) -> Comparison:
    """Put an error, a time or another number that should be small beside the paper's.

    It is better below paper / margin, reproduced up to paper · margin, and differs above.
    """
    if ours < paper / margin:
        verdict: Verdict = "better"
    else:
        verdict = "reproduced" if ours <= paper * margin else "differs"
    return Comparison(what=what, unit=unit, ours=ours, paper=paper, verdict=verdict)


def tally(findings: RecordedFindings) -> dict[Verdict, int]:
    """Count the verdicts on numbers and statements, the best verdict first."""
    verdicts = [c.verdict for c in findings.comparisons] + [c.verdict for c in findings.claims]
    return {verdict: verdicts.count(verdict) for verdict in get_args(Verdict)}


def format_cell(value: Cell) -> str:
    """Write a cell: floats in three digits or more, None as a dash, anything else unchanged."""
    if value is None:
        return "–"
    if isinstance(value, float):
        return f"{value:.3g}" if abs(value) < LARGE else f"{value:.0f}"
    return str(value)


def join_named(numbers: Mapping[str, float]) -> str:
    """Write numbers after their names, separated by commas."""
    return ", ".join(f"{name} {number:.2f}" for name, number in numbers.items())
