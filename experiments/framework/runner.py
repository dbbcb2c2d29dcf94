"""Running experiments: those that are up to date are not repeated, the others keep to a time."""

from __future__ import annotations

import logging
import time
import traceback
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from experiments.framework.experiment import Experiment, Findings, Setting
from experiments.framework.machine import software, with_load_after
from experiments.framework.record import (
    Record,
    RecordedFindings,
    read_record,
    record_path,
    write_record,
)
from shared_schema.common import InputError

logger = logging.getLogger(__name__)
LEAST = 15.0  # s; with less time left, an experiment is not begun
ALMOST = 0.9  # share of its time after which an experiment that is not finished ends


@dataclass
class Outcome:
    """What one start has done.

    Attributes
    ----------
    done : int
        Number of experiments that were measured now.
    unfinished, failed : list of str
        Names of those that the next start goes on with, and of those with an error.
    """

    done: int = 0
    unfinished: list[str] = field(default_factory=list)
    failed: list[str] = field(default_factory=list)


def find(experiments: Iterable[Experiment[Any]], names: Sequence[str]) -> list[Experiment[Any]]:
    """Find experiments by their names, in their own order.

    Raises
    ------
    InputError
        If a name is unknown.
    """
    known = {experiment.name: experiment for experiment in experiments}
    for name in names:
        if name not in known:
            raise InputError(f"'{name}': expected one of {', '.join(known)}")
    return [experiment for name, experiment in known.items() if name in names]


def figure_file(experiment: str, figure: str) -> str:
    """File name of a figure."""
    return f"{experiment}-{figure}.png" if figure != experiment else f"{experiment}.png"


def current_record(experiment: Experiment[Any], setting: Setting, out: Path) -> Record | None:
    """Read the record of an experiment if it matches the data and networks of the setting.

    Its figures must be there as well. Without the data at hand, the record counts as current.
    """
    record = read_record(record_path(out, experiment.name))
    if record is None or not all((out / file).is_file() for file in record.findings.captions):
        return None
    try:
        inputs = setting.fingerprint(experiment)
    except InputError:
        return record
    return record if record.inputs == inputs else None


def run(
    experiments: Sequence[Experiment[Any]],
    setting: Setting,
    out: Path,
    *,
    command: str = "",
    again: bool = False,
    seconds: float | None = None,
    after: Callable[[], object] = lambda: None,
    after_error: Callable[[Sequence[Experiment[Any]]], object] | None = None,
) -> Outcome:
    """Measure the experiments without a current record, in order, until the setting's deadline.

    Parameters
    ----------
    experiments : sequence of Experiment
    setting : Setting
    out : Path
        Folder of the records and figures; created if missing.
    command : str
        Command line, for the records.
    again : bool
        Measure experiments with a current record as well, as after a change of their code.
    seconds : float, optional
        Time of every experiment instead of its own.
    after : callable
        Called after every experiment, for instance to write a report.
    after_error : callable, optional
        Called with the following experiments after one that has failed, whose traceback its record
        keeps. Without this function, a failure ends the run.

    Raises
    ------
    InputError
        If a dataset is missing, before any work; existing records are kept.
    """
    for experiment in experiments:
        setting.fingerprint(experiment)
    outcome = Outcome()
    for number, experiment in enumerate(experiments, 1):
        here = f"{experiment.name} ({number} of {len(experiments)})"
        earlier = None if again else current_record(experiment, setting, out)
        if earlier is not None and earlier.finished:
            logger.info("%s: up to date", here)
            if earlier.error:
                outcome.failed.append(experiment.name)
            continue
        if setting.seconds_left < LEAST:
            outcome.unfinished.append(experiment.name)
            continue
        logger.info("%s: %s", here, experiment.title)
        limit = seconds or experiment.seconds
        caught = after_error is not None
        record = measured(experiment, setting, out, command, limit, earlier, caught)
        outcome.done += 1
        after()
        if not record.finished:
            outcome.unfinished.append(experiment.name)
        if record.error:
            outcome.failed.append(experiment.name)
            logger.info("%s: failed", here)
            if after_error is not None:
                after_error(experiments[number:])
        else:
            state = "" if record.finished else ", not finished"
            logger.info("%s: %.1f min%s", here, record.seconds / 60, state)
    return outcome


def measured(
    experiment: Experiment[Any],
    setting: Setting,
    out: Path,
    command: str = "",
    limit: float = float("inf"),
    earlier: Record | None = None,
    caught: bool = False,
) -> Record:
    """Measure an experiment; write its figures, then its record.

    Parameters
    ----------
    experiment, setting, out, command
        As for `run`.
    limit : float
        Seconds that it may take, over all starts.
    earlier : Record, optional
        Record of an earlier start that has not finished it.
    caught : bool
        Record the traceback of an error instead of raising it.
    """
    out.mkdir(parents=True, exist_ok=True)
    setting.prepare(experiment)
    spent = earlier.seconds if earlier is not None else 0.0
    began, machine, error = time.monotonic(), setting.machine(), ""
    within = setting.until(min(setting.deadline, began + limit - spent))
    try:
        found = experiment.measure(within)
    except Exception:  # whatever one does wrong, the others are worth their time
        if not caught:
            raise
        found, error = Findings(), traceback.format_exc()
    spent += time.monotonic() - began
    record = Record(
        experiment=experiment.name,
        configuration=setting.configuration(),
        seed=setting.seed,
        command=command,
        machine=with_load_after(machine),
        software=software(),
        datasets=setting.used_datasets(experiment),
        runs=setting.used_runs(experiment),
        inputs=setting.fingerprint(experiment),
        seconds=spent,
        finished=found.finished or spent > ALMOST * limit,
        error=error,
        findings=recorded(found, experiment.name, out),
    )
    write_record(record, record_path(out, experiment.name))
    return record


def recorded(found: Findings, name: str, out: Path) -> RecordedFindings:
    """Write the figures, and return the findings without them."""
    captions = {}
    for figure_name, (figure, caption) in found.figures.items():
        from shared_schema.common.drawing import save

        file = figure_file(name, figure_name)
        save(figure, out / file)
        captions[file] = caption
    return RecordedFindings(
        tables=tuple(found.tables),
        comparisons=tuple(found.comparisons),
        claims=tuple(found.claims),
        captions=captions,
        numbers=found.numbers,
    )
