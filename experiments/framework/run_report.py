"""Running the studies of a report at a scale in order, and the report on them."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

from experiments.beyond.catalogue import BEYOND
from experiments.framework.resources import Resources
from experiments.framework.studies_report import Report, write_report
from experiments.framework.study import Study, current_record, run_study
from experiments.paper.catalogue import REPRODUCTION
from shared_schema.common.errors import InputError

REPORTS = (REPRODUCTION, BEYOND)


def find_report(names: Sequence[str]) -> Report:
    """Find the report of some studies.

    Raises
    ------
    InputError
        If a name is unknown, or they are of different reports.
    """
    report_of = {study.name: report for report in REPORTS for study in report.studies}
    for name in names:
        if name not in report_of:
            raise InputError(f"study '{name}': expected one of {', '.join(report_of)}")
        if report_of[name] is not report_of[names[0]]:
            raise InputError(f"study '{name}': expected one of the report of '{names[0]}'")
    return report_of[names[0]]


def find_studies(names: Sequence[str]) -> list[Study]:
    """Find studies of one report by their names, in the order of the report.

    Raises
    ------
    InputError
        If a name is unknown, or they are of different reports.
    """
    return [study for study in find_report(names).studies if study.name in names]


def reproduce(
    studies: Sequence[Study],
    resources: Resources,
    out: Path,
    again: bool = False,
    of: Report = REPRODUCTION,
) -> int:
    """Run the studies without a current record, and write the report on all records.

    Parameters
    ----------
    studies : sequence of Study
    resources : Resources
    out : Path
        Folder of the records, figures and report; created if missing.
    again : bool
        Run the studies with a current record as well, as after a change of their code.
    of : Report
        The report that they belong to.

    Returns
    -------
    int
        Number of studies run now.

    Raises
    ------
    InputError
        If a dataset is missing; existing records are kept.
    """
    for study in studies:  # names a missing dataset before any work
        study.fingerprint(resources)
    out.mkdir(parents=True, exist_ok=True)
    done = 0
    for number, study in enumerate(studies, 1):
        here = f"surrogate study {study.name} ({number} of {len(studies)})"
        if not again and current_record(study, resources, out):
            print(f"{here}: up to date", file=sys.stderr, flush=True)
            continue
        print(f"{here}: {study.title}", file=sys.stderr, flush=True)
        record = run_study(study, resources, out)
        report(resources, out, of)
        done += 1
        print(f"{here}: {record.minutes:.1f} min", file=sys.stderr, flush=True)
    if done == 0:
        report(resources, out, of)
    return done


def report(resources: Resources, out: Path, of: Report = REPRODUCTION) -> None:
    """Write the report on all its studies with a current record."""
    records = {study.name: current_record(study, resources, out) for study in of.studies}
    write_report(of, resources.scale, records, out)
